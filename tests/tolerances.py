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

SYMPLECTIC = 1e-7
"""Of a Jacobian from central differences over 2e-4 mm [1]: the cubed step, and roundings of 1e-13 mm over the step."""

FOCUS_MM = 1e-11
"""Where a ray that was bent once crosses the axis [mm]: roundings near 100 mm, over slopes of a hundredth and more."""

BISECTED_MM = 1e-10
"""A root bisected to the last bit of the path [mm], its normal by complex steps: roundings along a few surfaces."""
