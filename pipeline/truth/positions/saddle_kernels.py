"""Light of an ideal corner at one image position: the weight of a bundle on white and on black. Kernels only.

The corner's coordinates are those along its two edges: white where they have the same sign. The bundle is a disc of
triangles on which coordinates are linear, so the two edges cut them exactly; what remains is the error of the linear
interpolation, which falls with the square of the triangles' size.
"""

import math

from pipeline.jit.decorators import inline, kernel


@kernel
def blend(fields, basis, nodes):
    """Nodes (a, r, 3), written: the sum of fields (k, a, r, 3) with weights (k,)."""
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            for c in range(nodes.shape[2]):
                nodes[i, j, c] = 0.0
                for k in range(basis.shape[0]):
                    nodes[i, j, c] += basis[k] * fields[k, i, j, c]


@kernel
def corner_light(nodes, ratio):
    """Integral of weight times (ratio + 1) on white and (ratio - 1) on black, with `ratio` as of `saddle`.

    `nodes` (a, r, 3): per direction and share 0, 1 / (r - 1), ..., 1 of the radius, both coordinates and the density on
    the unit disc.
    """
    directions, rings = nodes.shape[0], nodes.shape[1] - 1
    total = 0.0
    for i in range(directions):
        j = i + 1 if i + 1 < directions else 0
        for k in range(rings):
            a, b, c, d = nodes[i, k], nodes[i, k + 1], nodes[j, k + 1], nodes[j, k]
            if (i + k) % 2 == 1:  # Diagonals alternate, otherwise all would lean to one side.
                a, b, c, d = d, c, b, a
            outer = (k + 1.0) * (a[2] + b[2] + c[2]) * (ratio + signed_share(a, b, c))
            inner = k * (a[2] + c[2] + d[2]) * (ratio + signed_share(a, c, d)) if k > 0 else 0.0
            # The ring's sector, of area (2 k + 1) pi / (directions rings^2), is divided in the ratio k + 1 to k.
            total += (outer + inner) / 3.0
    return total * math.pi / (directions * rings * rings)


@inline
def signed_share(a, b, c):
    """Share of a triangle where u and v have equal signs, minus that where they differ."""
    if (a[0] > 0.0) == (b[0] > 0.0) == (c[0] > 0.0):
        sign = 1.0 if a[0] > 0.0 else -1.0
        return sign * mean_sign(a[1], b[1], c[1])
    # Rotate the corners so that the first one lies alone beyond u = 0.
    if (a[0] > 0.0) == (b[0] > 0.0):
        a, b, c = c, a, b
    elif (a[0] > 0.0) == (c[0] > 0.0):
        a, b, c = b, c, a
    to_b, to_c = a[0] / (a[0] - b[0]), a[0] / (a[0] - c[0])
    at_b, at_c = a[1] + to_b * (b[1] - a[1]), a[1] + to_c * (c[1] - a[1])
    alone = to_b * to_c * mean_sign(a[1], at_b, at_c)
    # The rest: (b', b, c') and (b, c, c').
    rest = (1.0 - to_b) * to_c * mean_sign(at_b, b[1], at_c) + (1.0 - to_c) * mean_sign(b[1], c[1], at_c)
    return (alone - rest) if a[0] > 0.0 else (rest - alone)


@inline
def mean_sign(p, q, r):
    """Mean sign over a triangle of a linear function with these values at its corners."""
    if p > 0.0 and q > 0.0 and r > 0.0:
        return 1.0
    if not (p > 0.0 or q > 0.0 or r > 0.0):
        return -1.0
    if (p > 0.0) == (q > 0.0):
        p, r = r, p
    elif (p > 0.0) == (r > 0.0):
        p, q = q, p
    alone = p / (p - q) * (p / (p - r))
    return 2.0 * alone - 1.0 if p > 0.0 else 1.0 - 2.0 * alone
