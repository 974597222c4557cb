"""The energy of overhang relaxation and its gradient: how far a surface is from its own shape and from the limit.

E = E_R + λ E_N (seed paper, Section 3.2; Liu & Jacobson 2021):

E_R = Σ_k Σ_{f∋k} Σ_{ij∈f} w_ij ‖R_k d_ij − d'_ij‖² + Σ_ties w ‖R_i d_ij − d'_ij‖²
    spokes and rims around each vertex k with cotangent weights, and ties across walls;
E_N = Σ_f a_f max(0, φ_f − aim_f)²
    over faces, φ the angle of overhang: the squared angle from a face's normal to the nearest normal of the spindle.

Rotations R_k are the best ones for the given vertices, so that dE/dV needs no derivative of theirs.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def edge_covariances(
    V: Array, F: Faces, D: Array, W: Array, TI: Faces, TJ: Faces, TD: Array, TW: Array, S: Array
) -> None:
    """S_k = Σ w d d'ᵀ over spokes, rims and ties of each vertex, shape (n, 3, 3); receives the result.

    V vertices (n, 3), F faces (m, 3), D edges of the input (m, 3, 3) and their weights W (m, 3); ties from TI to
    TJ (k,), as they were TD (k, 3), with weights TW (k,).
    """
    S[:] = 0.0
    T = np.empty((3, 3))
    for f in range(len(F)):
        T[:] = 0.0
        for e in range(3):
            i, j, w = F[f, (e + 1) % 3], F[f, (e + 2) % 3], W[f, e]
            for b in range(3):
                x = w * (V[j, b] - V[i, b])
                for a in range(3):
                    T[a, b] += D[f, e, a] * x
        for c in range(3):
            k = F[f, c]
            for a in range(3):
                for b in range(3):
                    S[k, a, b] += T[a, b]
    for t in range(len(TI)):
        i, j = TI[t], TJ[t]
        for b in range(3):
            x = TW[t] * (V[j, b] - V[i, b])
            for a in range(3):
                S[i, a, b] += TD[t, a] * x


@nb.njit(cache=True, nogil=True)
def shape_energy(
    V: Array,
    F: Faces,
    D: Array,
    W: Array,
    TI: Faces,
    TJ: Faces,
    TD: Array,
    TW: Array,
    R: Array,
    G: Array,
) -> float:
    """E_R with rotations R (n, 3, 3); its gradient is added to G (n, 3)."""
    E = 0.0
    Q = np.empty((3, 3))
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        for i in range(3):
            for j in range(3):
                Q[i, j] = R[a, i, j] + R[b, i, j] + R[c, i, j]
        for e in range(3):
            i, j, w = F[f, (e + 1) % 3], F[f, (e + 2) % 3], W[f, e]
            # Σ over the corners of ‖R d − d'‖², with ‖R d‖ = ‖d‖.
            square = 0.0
            for x in range(3):
                old = D[f, e, x]
                turned = Q[x, 0] * D[f, e, 0] + Q[x, 1] * D[f, e, 1] + Q[x, 2] * D[f, e, 2]
                new = V[j, x] - V[i, x]
                square += 3.0 * (new * new + old * old) - 2.0 * new * turned
                g = 2.0 * w * (3.0 * new - turned)
                G[j, x] += g
                G[i, x] -= g
            E += w * square
    for t in range(len(TI)):
        i, j = TI[t], TJ[t]
        for x in range(3):
            turned = R[i, x, 0] * TD[t, 0] + R[i, x, 1] * TD[t, 1] + R[i, x, 2] * TD[t, 2]
            g = V[j, x] - V[i, x] - turned
            E += TW[t] * g * g
            G[j, x] += 2.0 * TW[t] * g
            G[i, x] -= 2.0 * TW[t] * g
    return E


@nb.njit(cache=True, nogil=True)
def normal_energy(
    V: Array,
    F: Faces,
    weight: Array,
    up: Array,
    aim: Array,
    both: bool,
    G: Array,
    angle: Array,
    area: Array,
) -> float:
    """E_N for weights λ a_f (m,), build directions (m, 3) and aims (m,), rad; its gradient is added to G (n, 3).

    `angle` (m,) receives each face's angle of overhang, rad: positive where it faces down, or its amount with
    `both` sides counted. `area` (m,) receives the faces' areas, mm².
    """
    E = 0.0
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        x0, x1, x2 = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        y0, y1, y2 = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        n0, n1, n2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
        doubled = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        area[f] = 0.5 * doubled
        if doubled == 0.0:
            angle[f] = 0.0
            continue
        n0, n1, n2 = n0 / doubled, n1 / doubled, n2 / doubled
        rise = n0 * up[f, 0] + n1 * up[f, 1] + n2 * up[f, 2]
        side = -1.0
        if rise > 0.0 and both:
            side = 1.0
        across = np.sqrt(max(0.0, 1.0 - rise * rise))
        angle[f] = np.arctan2(side * rise, across)
        over = angle[f] - aim[f]
        if over <= 0.0 or weight[f] == 0.0:
            continue
        E += weight[f] * over * over
        # dE/dn is along the meridian; a face that lies flat has none.
        k = 2.0 * weight[f] * over * side / (max(across, 1e-6) * doubled)
        h0, h1, h2 = k * (up[f, 0] - rise * n0), k * (up[f, 1] - rise * n1), k * (up[f, 2] - rise * n2)
        for corner in range(3):
            i, j, v = F[f, (corner + 1) % 3], F[f, (corner + 2) % 3], F[f, corner]
            z0, z1, z2 = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
            G[v, 0] += h1 * z2 - h2 * z1
            G[v, 1] += h2 * z0 - h0 * z2
            G[v, 2] += h0 * z1 - h1 * z0
    return E


@nb.njit(cache=True, nogil=True)
def volume_energy(V: Array, F: Faces, wanted: float, weight: float, G: Array) -> float:
    """weight × (volume − wanted)², the enclosed volume in mm³; its gradient is added to G (n, 3)."""
    volume = 0.0
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        volume += V[a, 0] * (V[b, 1] * V[c, 2] - V[b, 2] * V[c, 1]) / 6.0
        volume += V[a, 1] * (V[b, 2] * V[c, 0] - V[b, 0] * V[c, 2]) / 6.0
        volume += V[a, 2] * (V[b, 0] * V[c, 1] - V[b, 1] * V[c, 0]) / 6.0
    k = 2.0 * weight * (volume - wanted) / 6.0
    for f in range(len(F)):
        for corner in range(3):
            a, b, c = F[f, corner], F[f, (corner + 1) % 3], F[f, (corner + 2) % 3]
            G[a, 0] += k * (V[b, 1] * V[c, 2] - V[b, 2] * V[c, 1])
            G[a, 1] += k * (V[b, 2] * V[c, 0] - V[b, 0] * V[c, 2])
            G[a, 2] += k * (V[b, 0] * V[c, 1] - V[b, 1] * V[c, 0])
    return weight * (volume - wanted) ** 2


@nb.njit(cache=True, nogil=True)
def collapse_energy(V: Array, F: Faces, D: Array, R: Array, rest: Array, ratio: float, G: Array) -> float:
    """Σ a_f max(0, a_f / s_f − ratio)² over faces of areas `rest` (m,), mm²; its gradient is added to G (n, 3).

    s_f is a face's area as seen along the normal that the rotations R (n, 3, 3) of its corners make of its old one:
    nothing until that shrinks by the ratio, without bound as it goes to 0, and infinite for an inverted face. The
    gradient takes the rotations as given.
    """
    E = 0.0
    for f in range(len(F)):
        if rest[f] == 0.0:
            continue
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        o0 = D[f, 0, 1] * D[f, 1, 2] - D[f, 0, 2] * D[f, 1, 1]
        o1 = D[f, 0, 2] * D[f, 1, 0] - D[f, 0, 0] * D[f, 1, 2]
        o2 = D[f, 0, 0] * D[f, 1, 1] - D[f, 0, 1] * D[f, 1, 0]
        m0 = m1 = m2 = 0.0
        for k in range(3):
            v = F[f, k]
            m0 += R[v, 0, 0] * o0 + R[v, 0, 1] * o1 + R[v, 0, 2] * o2
            m1 += R[v, 1, 0] * o0 + R[v, 1, 1] * o1 + R[v, 1, 2] * o2
            m2 += R[v, 2, 0] * o0 + R[v, 2, 1] * o1 + R[v, 2, 2] * o2
        length = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
        if length == 0.0:
            return np.inf
        m0, m1, m2 = m0 / length, m1 / length, m2 / length
        x0, x1, x2 = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
        y0, y1, y2 = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
        seen = 0.5 * (m0 * (x1 * y2 - x2 * y1) + m1 * (x2 * y0 - x0 * y2) + m2 * (x0 * y1 - x1 * y0))
        if seen <= 0.0:
            return np.inf
        over = rest[f] / seen - ratio
        if over <= 0.0:
            continue
        E += rest[f] * over * over
        k = -rest[f] * over * rest[f] / (seen * seen)
        for corner in range(3):
            i, j, v = F[f, (corner + 1) % 3], F[f, (corner + 2) % 3], F[f, corner]
            z0, z1, z2 = V[j, 0] - V[i, 0], V[j, 1] - V[i, 1], V[j, 2] - V[i, 2]
            G[v, 0] += k * (m1 * z2 - m2 * z1)
            G[v, 1] += k * (m2 * z0 - m0 * z2)
            G[v, 2] += k * (m0 * z1 - m1 * z0)
    return E
