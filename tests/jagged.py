"""Random jagged curves: simple, of segments of one length or a little shorter, mm.

Five kinds in turn, by seed: noise on a circle, a star with spikes, a tour through random points, a star that was
shaken, and a wavy circle with noise. Every seventh closed curve runs clockwise.
"""

from __future__ import annotations

import numpy as np
import shapely

SPACING = 5.0


def jagged(seed):
    """A simple closed curve, shape (n, 2); of odd seeds its corners are cut by even sampling, of others kept."""
    rng = np.random.default_rng(seed)
    kind = (_noise, _spikes, _tour, _shaken, _waves)[seed % 5]
    while True:
        corners = kind(rng)
        points = evenly(corners) if seed % 2 else divided(corners, SPACING)
        outline = shapely.Polygon(points)
        if outline.is_valid:
            points = shapely.get_coordinates(shapely.geometry.polygon.orient(outline))[:-1]
            return np.ascontiguousarray(points[::-1]) if seed % 7 == 0 else points


def divided(points, length, closed=True):
    """Segments divided into equal parts no longer than `length`: other points, the same curve."""
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    parts = []
    for a, b in zip(points, ends, strict=False):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / length - 1e-9)))
        parts.append(a + (b - a) * np.arange(count)[:, None] / count)
    return np.vstack(parts if closed else [*parts, points[-1:]])


def evenly(points):
    """Points at equal distances along a closed curve, from its first, and no corners but these."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1))])
    count = max(6, int(np.ceil(way[-1] / SPACING)))
    places = np.arange(count) * way[-1] / count
    return np.column_stack([np.interp(places, way, np.append(x, x[0])) for x in points.T])


def around(radii):
    """Points at these radii, at equal angles."""
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return np.column_stack([radii * np.cos(angle), radii * np.sin(angle)])


def _star(rng, count, depth, radius):
    return around(radius * (1 - depth * rng.random(count)))


def _noise(rng):
    return _star(rng, rng.integers(20, 120), rng.uniform(0.05, 0.3), rng.uniform(60, 200))


def _spikes(rng):
    return _star(rng, rng.integers(5, 16), rng.uniform(0.3, 0.8), rng.uniform(80, 250))


def _shaken(rng):
    star = evenly(_star(rng, rng.integers(5, 16), rng.uniform(0.2, 0.5), rng.uniform(80, 250)))
    return star + rng.normal(0, rng.uniform(0.1, 0.35) * SPACING, star.shape)


def _waves(rng):
    count = rng.integers(60, 200)
    radius = rng.uniform(80, 200)
    angle = 2 * np.pi * np.arange(count) / count
    waves = radius * (1 + 0.25 * np.cos(rng.integers(2, 6) * angle + 6 * rng.random()))
    return around(waves + rng.uniform(1, 8) * rng.uniform(-1, 1, count))


def _tour(rng):
    """A short closed way through random points: crossings are taken out until there are none (2-opt)."""
    count, size = int(rng.integers(6, 20)), rng.uniform(80, 250)
    points = rng.uniform(-size, size, (count, 2))
    shorter = True
    while shorter:
        shorter = False
        for i in range(count - 1):
            for j in range(i + 2, count - (i == 0)):
                a, b, c, d = points[[i, i + 1, j, (j + 1) % count]]
                old = np.linalg.norm(b - a) + np.linalg.norm(d - c)
                if np.linalg.norm(c - a) + np.linalg.norm(d - b) < old - 1e-9:
                    points[i + 1 : j + 1] = points[i + 1 : j + 1][::-1]
                    shorter = True
    return points
