"""Every tolerance of the proofs in `laws`, `published` and `naive`: a unit and a reason each.

Where a law can be shown by convergence, it needs none of these, except how close an observed order must come.
"""

ORDER = 0.02
"""Of an observed order of convergence: the next term of the series at the coarsest step used, a few per mille."""

PRINTED_6_MM = 1e-6
"""A listing with six decimals [mm]: half a unit of the position and as much again from rounded starting heights."""

PRINTED_6_TANGENT = 1e-6
"""A listing with six decimals, slopes [1]: as above."""

PRINTED_4_MM = 0.5001e-4
"""Half a unit of a figure printed to four decimals [mm]."""

PRINTED_3_MM = 0.5001e-3
"""Half a unit of a figure printed to three decimals [mm]."""

PRINTED_2_MM = 0.5001e-2
"""Half a unit of a figure printed to two decimals [mm]."""

PRINTED_3_SHARE = 0.5001e-3
"""Half a unit of a share printed to three decimals [1]."""

PRINTED_BFD_MM = 0.15
"""A back focal distance printed with a prescription [mm]: radii of three decimals and indices of three near 100 mm."""

NOMINAL_EFL = 0.0075
"""A focal length in the name of a lens [relative]: tables are scaled to it and rounded; what is off more is marked."""

ROUND_TRIP_MM = 1e-9
"""A lens through another program's file [mm]: a curvature is 1 / radius rounded, and inches are 25.4 mm."""

REVERSED_MM = 1e-12
"""A ray traced there and back [mm]: about 40 roundings of numbers near 100 mm (1.4e-14 mm each)."""

BISECTED = 1e-12
"""Forty bisections of an angle or a way near 1 [1 or rad]: 2^-40 is 9e-13; sums of some hundred shares err less."""

ROUNDING_MM = 1e-10
"""Two ways to compute the same length near 500 mm [mm]: roundings grow where lines cross at small angles."""

TEXTBOOK_MM = 1e-11
"""Two formulas for the same ray through eleven surfaces [mm]: the textbook's root of the quadratic cancels digits."""

HALF_PIXEL_PX = 1e-9
"""A linear position image is solved exactly [px]: roundings of values near 100 mm over steps of 0.01 mm."""

SAME_GEOMETRY_PX = 1e-9
"""The same scene in another world [px]: roundings of poses of 500 mm, over at least 0.02 mm per px."""

STORED_PX = 2e-4
"""Position images are kept in single precision [px]: half a unit of 64 mm is 4e-6 mm, over at least 0.02 mm per px."""

SIGMAS = 5.0
"""Largest of a few hundred deviations over a standard error known from at least 16 repetitions [1]."""

ONCE_IN_A_MILLION = 1e-6
"""Probability that an honest standard error fails by chance [1]: tests ask it some hundred times."""

STRATIFIED = 1e-4
"""Of an integral over 16,384 stratified points, smooth but sixfold brighter at one edge [relative]: 3e-5 is seen."""

HONEST = (0.7, 1.4)
"""rms of actual error over stated error [1]: each is the spread of only four replicas, here pooled."""

RULE_OF_BIAS = 0.03
"""Figures of the two-plane bias are printed to three digits and were found with other random rays [relative]."""

FIRST_ORDER_BLUR = 0.02
"""Covariance mapped by a constant Jacobian [relative]: distortion and coma across a blur, and sampling."""

MOVED_TRUTH_PX = 0.05
"""Catalogue instead of printed indices, plenoptic rig of 800 x 600 pixels [px]: 0.04 stated, one digit."""

STATED_INDEX = 5e-5
"""n_d as a vendor states it beside its formula [1]: Sumita's prints are up to 3.8e-5 off their own formulas."""

PRINTED_5_INDEX = 6e-6
"""An index printed to five decimals [1]: half a unit, and a tenth of a unit for formulas with rounded coefficients."""

CODEV_INDEX = 1e-6
"""An index printed to six decimals [1]: half a unit, and as much again for the catalogue's edition."""

PRINTED_ABBE = 0.01
"""An Abbe number printed to two decimals [1]: one unit, because a vendor may compute it from rounded indices."""

MODEL_MEDIAN, MODEL_95, MODEL_WORST = 1.9e-4, 5e-4, 1.4e-3
"""Index from n_d and V_d alone, largest error from 400 to 700 nm [1]: median glass, 95 per cent, all."""

MODEL_NARROW_MEDIAN, MODEL_NARROW_95, MODEL_NARROW_WORST = 9e-5, 2.2e-4, 9e-4
"""The same from 436 to 656 nm [1]."""

SYMPLECTIC = 1e-7
"""Of a Jacobian from central differences over 2e-4 mm [1]: the cubed step, and roundings of 1e-13 mm over the step."""

FOCUS_MM = 1e-11
"""Where a ray that was bent once crosses the axis [mm]: roundings near 100 mm, over slopes of a hundredth and more."""

BISECTED_MM = 1e-10
"""A root bisected to the last bit of the path [mm], its normal by complex steps: roundings along a few surfaces."""

PRINTED_6_RATIO = 0.5001e-6
"""Half a unit of a ratio printed to six decimals [1]."""

GRID_PX = 0.5
"""A regular grid fitted to white images against the micro-images of a tilted array [px]: it has no room for their
keystone, 6 to 7 µm of 52 to 57 mm at 14 mm from the axis, 0.28 to 0.34 px; single centres scatter by 0.29 px."""

GRID_RMS_PX = 0.15
"""The same, rms [px]: half of the scatter of single centres; without the tilt it is 0.18 px and more."""

FOCUS_PAIR_MM = 0.13
"""An object distance near 1:1 [mm]: the sensor's is stated to 0.1 mm, half a unit, and indices from dispersion formulas
in place of the printed ones, which the add-on may have used, move its image by 0.08 mm."""

NODE_MM = 0.5001e-6
"""Half a unit of a distance printed to six decimals [mm]."""

CALIBRATED_FOCUS_MM = 1.4e-3
"""An in-focus distance printed to three decimals [mm]: half a unit, and half a unit of the sixth decimal of the array's
distance, which grows by 5.6 to the virtual object and by 300 to the real one."""

MOVED_MM = 2e-12
"""The same ray in a frame and in a turned one [mm]: as a ray traced there and back, and 100 mm turned at each end."""

BORESIGHT_MM = 1e-9
"""A chief ray that leaves along the axis [mm]: Newton's steps end at 1e-9 mm at the stop."""

DETECTED_PX = 0.1
"""A corner or disc found by OpenCV in an 8-bit picture of 16 samples per pixel [px]: its detectors claim less."""

COARSE_GRID_PX = 2e-3
"""Pixels of 1.3 mm on the target [px]: a position is interpolated linearly between four of them."""

DIRECT_PX = 1e-4
"""What method `direct` claims [px]; quadrature alone is some hundred times better where nothing is missed."""

QUADRATURE_MM = 1e-6
"""A mean on the target [mm]: a hundredth of what `direct` claims, where 0.15 mm and more are a pixel."""

CLOSED_FORM = 1e-6
"""Quadrature against a closed form or a second trace [relative]: edges are bisected to 3e-8 of the way to a bound."""

VISIBLE_SHARE = 1.5e-3
"""A share of 16,384 scrambled Sobol points on one side of an edge [1]: 4e-4 rms is seen, independent ones had 4e-3."""

LIT_SHARE = 4e-3
"""A quotient of two pixels and a share, of 16,384 rays each [1]: pixels hold points of four dimensions, and across
one the share bends by up to 1e-3."""

HOMED_PX = 1e-6
"""A position found by Newton's method, by two routes through the lens [px]: 1e-9 mm at the stop, ten roundings."""

SADDLE_PX = 1e-3
"""A saddle that two ways must share [px]: its triangles err by some 1e-4, as the header of a table says."""

DENSE_SADDLE_PX = 0.01
"""A saddle in 2^18 rays over 16 px [px]: gradients scatter by 1e-3 of white, and a cubic over 1.2 px leaves 3e-3."""

DENSE_SADDLE_F2_PX = 0.05
"""The same at f/2 with 2^21 rays, a cubic over 2 px [px]: noise, by which cubics over 0.6 to 2 px differ."""

CENTROID_PX = 1e-3
"""A closed form to second order in the disc's radius over its distance [px]: 1e-2 cubed, of discs of 100 px."""

DENSE_CENTROID_PX = 0.01
"""A centroid of 2^18 Sobol points over 5,000 px, a tenth to a third of them lit [px]: 0.004 is seen."""

DETECTOR_RMS_PX, DETECTOR_MEAN_PX = 0.05, 0.02
"""What a corner detector may differ from the saddle in an image with less than a pixel of blur [px]: what good ones
claim on images without noise."""

HALVED_SQUARE = 0.1
"""Of the fall of a shift when a square's edge goes from 0.5 to 0.25 px [relative]: the fourth order in the edge, in the
penumbra, where the lit part of an aperture changes within a pixel; half of it one step further."""

NOISY_PX = 0.03
"""Mean place that a pixel sees, by 131,072 rays of a bundle 55 px wide [px]: scrambled points scatter by up to 0.01."""

MICRO_IMAGE_PX = 1e-3
"""Centroids and outlines of micro-images as documented [px]: edges are bisected to 2^-17 of 12 to 40 px."""

SAMPLED_SHARE, MEAN_SHARE = 0.012, 1e-3
"""A hit fraction of 1,024 scrambled Sobol points against a closed form [relative]: the worst of 12,288 positions, 0.008
is seen; their mean, 1e-4 and the reference's own error."""

LATERAL_COLOUR = 0.01
"""Lateral colour of a singlet at 4 mrad against paraxial optics [relative]: terms of third order are some 1e-3 of the
height, and differ between two wavelengths by a hundredth of that; the pinhole's bundle has a width."""

LIT_ERRORS = 4.5
"""Standard errors within which a mean of random paths must lie. The error is that of 64 scrambles, so that by Student's
law with 63 degrees of freedom one of 33,000 comparisons fails by chance; seeds are fixed, so none does so now and then.
"""

KNOWN_FLUX = 6e-4
"""Light of a pixel by cubics against quadrature at the pixel [relative to the axis]: 4e-4 is seen where vignetting
begins between two of the positions that a cubic passes."""

FURNACE = 5e-4
"""Light that a white surface returns, less 1 [relative]: tables of reflected light are right to 2e-4, and linear
between 64 nodes along each axis."""

COAT_OVER_PLASTIC, COAT_OVER_METAL = 0.007, 0.045
"""Light that a white plastic and a white metal lose below a clear coat [relative]: what single facets reflect leaves by
the direction in which the coat lets less through; 0.006 and 0.042 at most, with roughnesses of 0.4 and 0.5.
"""

ALL_REFLECTIONS = 0.01
"""Light that a rough surface returns over that of walks on its facets, less 1 [relative]: what is fitted to walks is
right to 0.007, and the means of 300,000 walks to 0.001."""

SAME_COLOUR = 0.01
"""Components of sRGB from 16 wavelengths 20 nm apart, against all between 360 and 780 nm [1]: sums with other steps
differ by some thousandths."""

COLOUR_RMS, COLOUR_WORST = 0.003, 0.01
"""Error of colours of a channel, relative to each, over many of them and at worst [1]: of 1 % people see nothing (about
delta E 1)."""
TWICE_RMS, TWICE_WORST = 0.015, 0.12
"""The same of light that is reflected twice, by steep spectra [1]: means of products over a slice are not products of
means. It is 0.5 % rms and 3 % at worst; 11 % in a channel with a long tail below illuminant A."""
MEAN_NM = 1e-3
"""Error of a mean wavelength [nm]: that of sums in steps of 0.02 nm over tables with corners. Lenses disperse less than
0.01 px there."""

SAME_NOISE, WORST_PIXEL = 1.15, 5.5
"""Differences between two noisy pictures in their standard errors [1]: rms over 432 pixels, 1.04 by chance with 24
seeds each, and the largest one."""

SINGLE = 1e-5
"""Least error that is assumed of a picture by Mitsuba [relative]: it sums in single precision."""

AIRY = 2e-4
"""Light over the peak, or contrast, of a circular pupil in 256 x 256 cells against the closed form [1]: cells at its
edge are right to a hundredth, and 3e-5 is seen."""

HUYGENS = 5e-3
"""Light over the perfect peak by 256 x 256 cells and by a square grid of 500 rays across, whose pupil has a ragged
edge [1]: it loses or wins a thousandth of the area, and 2e-3 is seen."""

MARECHAL = 5e-4
"""Strehl ratio against exp(-variance) for a variance of 0.06 [1]: the third moment of the phase, 1e-3 at most."""

SPOT_MM = 2e-5
"""Spots of rays, up to 8e-3 mm off, against first differences between cells of a wavefront [mm]: the third derivative
of the aberration times the square of a cell; 6e-6 is seen."""

SPREAD_ENERGY = 0.01
"""Light of the whole image over that of the pupil [1]: cells at the edge have the square of their share."""

MALUS_MM = 1e-11
"""Paths of 80 pairs of rays over 100 mm and more [mm]: a rounding of 1.4e-14 mm in each of a dozen sums."""

TWO_PLANE_MM = 1e-8
"""The same behind two-plane microlenses of index 5, whose bend is taken for a paraboloid [mm]: 2e-5 waves."""

DIFFRACTED_EDGE = 0.008
"""Light of a diffracted edge in an image of 16,384 or more rays per column [1]: the tail of Airy's pattern beyond the
ninth dark ring, 2 percent of the light, is an even veil there; 0.004 is seen."""

OPTILAND_STREHL = 5e-3
"""Strehl ratio by optiland [1]: twice what its two methods, by a Fourier transform and by Huygens's sum, are apart."""

OPTILAND_CONTRAST = 6e-3
"""Contrast by optiland's transfer function [1]: its grid of 256 x 256 rays has a ragged edge, and interpolation between
its frequencies adds to it; 4e-3 is seen."""

OPTILAND_AIMED_MM = 1e-7
"""Height of a chief ray of optiland [mm]: points at 1e8 mm are seen from a pupil some millimetres off, by 5e-8
mm in an image of 1 mm. Its aim, up to 9e-7 mm beside the centre of the stop, adds less: rays meet near the focus."""

COATED_ANGLE = 1e-8
"""A share of light by an angle from its cosine [1]: near 0 the angle is good to the root of a rounding, 1.5e-8 rad or
9e-7 degrees, and tables of the tests change by 0.01 per degree."""

MEAN_TRANSMISSION = 2e-3
"""Transmission of a narrow bundle on the axis against that of its axis [relative]: squares of angles of up to 0.1 at
eleven surfaces."""

HEXAGON = 0.04
"""Defocus of a hexagon, root mean square, over that of a circle of its area [relative]: 3 percent more, and aberrations
of the main lens."""

PRINTED_9 = 0.5001e-9
"""Half a unit of a figure kept to nine decimals [mm, or 1 of cosines]."""

ROUNDING_OF_LENGTHS = 1e-12
"""A few roundings of lengths below 200 mm through eleven surfaces [mm]: a listing may print all digits of a double."""

OPTICSTUDIO_EXIT_PUPIL_MM = 4e-7
"""OpticStudio's exit pupil of the Cooke triplet against ours and optiland's [mm]: it differs by 1.1e-7 and 3.2e-7."""

FIELD_TRANSMISSION = 1e-4
"""Transmission of a pixel [relative]: what docs/radiometry.md states; random rays of the slow twin err by 3e-5."""

REFOUND_MM = 1e-8
"""The mean of a bundle whose edge is found anew from elsewhere [mm]: to 3e-8 of its way each time, and errors around an
edge average out over a blur of 0.1 mm and less."""

FOCAL_LENGTH_REL = 1e-6
"""Focal length of a lens file against that of a naive reader [relative]: the goal of imports; indices of one formula at
587.56 and 587.5618 nm differ by 1e-7."""

PRINTED_INDEX = 1e-5
"""Index that a file or the formula of a maker has for a name [1], against that which is taken: five decimals."""
