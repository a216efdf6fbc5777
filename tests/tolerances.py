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

PRINTED_BFD_MM = 0.15
"""A back focal distance printed with a prescription [mm]: radii of three decimals and indices of three near 100 mm."""

NOMINAL_EFL = 0.0075
"""A focal length in the name of a lens [relative]: tables are scaled to it and rounded; what is off more is marked."""

ROUND_TRIP_MM = 1e-9
"""A lens through another program's file [mm]: a curvature is 1 / radius rounded, and inches are 25.4 mm."""

REVERSED_MM = 1e-12
"""A ray traced there and back [mm]: about 40 roundings of numbers near 100 mm (1.4e-14 mm each)."""

ROUNDING_MM = 1e-10
"""Two ways to compute the same length near 500 mm [mm]: roundings grow where lines cross at small angles."""

TEXTBOOK_MM = 1e-11
"""Two formulas for the same ray through eleven surfaces [mm]: the textbook's root of the quadratic cancels digits."""

HALF_PIXEL_PX = 1e-9
"""A linear position image is solved exactly [px]: roundings of values near 100 mm over steps of 0.01 mm."""

STORED_PX = 2e-4
"""Position images are kept in single precision [px]: half a unit of 64 mm is 4e-6 mm, over at least 0.02 mm per px."""

SIGMAS = 5.0
"""Largest of a few hundred deviations over a standard error known from at least 16 repetitions [1]."""

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
"""A corner or disc found by OpenCV in an 8-bit picture of 64 samples per pixel [px]: its detectors claim less."""

COARSE_GRID_PX = 2e-3
"""Pixels of 1.3 mm on the target [px]: a position is interpolated linearly between four of them, and moments of the
bundle leave its third ones out."""

DIRECT_PX = 1e-4
"""What method `direct` claims [px]; quadrature alone is some hundred times better where nothing is missed."""

CLOSED_FORM = 1e-6
"""Quadrature against a closed form or a second trace [relative]: edges are bisected to 3e-8 of the way to a bound."""

HALVED_SQUARE = 0.1
"""Of the fall of a shift when a square's edge goes from 0.5 to 0.25 px [relative]: the fourth order in the edge, in the
penumbra, where the lit part of an aperture changes within a pixel; half of it one step further."""
