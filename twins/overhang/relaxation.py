"""Overhang relaxation: a surface deforms as little as it can until no unlocked face leans beyond a limit.

The paper's method (Section 3.2) is the spherical shape analogy of Liu & Jacobson (2021): normals are drawn towards
those of a spindle while the surface stays as rigid as possible. Three things are different here, because the paper's
form stops short of the limit, and fails where both ends of a part are locked (docs/overhang-relaxation.md):

- the normals drawn are those of faces as they *are*, not of input vertices turned by a local rotation, and one that
  complies is left alone, so that it may give way to others;
- each face has an aim of its own, which moves inside the limit by what the face last missed it by (the multipliers
  of an augmented Lagrangian);
- opposite sides of a wall are tied together, the volume enclosed is kept, no face may turn over, and nothing may
  sink below the bed.

The energy is minimised by quasi-Newton steps with one factorisation, the Laplacian of the input.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from twins.entrances import checks_kinds
from twins.errors import SurfaceError
from twins.mesh_edges import edge_faults, middle_of
from twins.planes import PlaneStack
from twins.surface import make_surface, signed_volume
from twins.toolpath import Plane

from .contact import Contact, FlatTop
from .cotangent import face_edges
from .energy import normal_energy
from .inversions import turned_back
from .judge import UP, Judge
from .locks import as_flags, lock_base
from .quasi_newton import QuasiNewton
from .rigid_shape import RigidShape
from .surfaces import FacingSide, build_directions, check_side, mean_normal

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_STEPS = 5
"""Quasi-Newton steps between two changes of the aims."""
_SETTLED = 1e-5
"""Relative fall of the energy in a step below which the aims change at once."""
_MARGIN = math.radians(1.5)
"""All aims lie this far inside the limit at first, and move on by _WIDER while the limit is not reached."""
_WIDER, _WIDEST = math.radians(0.25), math.radians(3.0)
_FARTHEST = math.radians(20.0)
"""A face that cannot comply (between locked corners) has its aim no farther inside the limit."""
_LEVEL = math.radians(89.9)
"""A face beyond this angle of overhang leans no way in particular."""
_LIFT = 0.05
"""Greatest strain of an edge by the first lift of level ceilings."""
_PATIENCE = 5
"""Rounds without a gain after which the best result so far is the result."""


@dataclass(frozen=True, eq=False)
class OverhangRelaxation:
    """A surface with its overhang relaxed, and what was gained and paid.

    Attributes:
        surface: same connectivity as the input; the input itself where nothing was over the limit.
        iterations: quasi-Newton steps.
        reached: at most the tolerated share of the area over the limit is left.
        area: of the faces that count, before, mm²: all but those between locked vertices, on the bed, and with side
            "both" flat in the highest layer plane.
        over_before, over_after: area of those over the limit, mm².
        worst_before_deg, worst_after_deg: greatest angle of overhang among them; 0 if none counts or leans out.
        volume_change: relative, of what the surface encloses.
        mean_displacement, max_displacement: of all vertices, mm.
        inverted: faces turned inside out; 0 unless the part is forced to fold.
    """

    surface: trimesh.Trimesh
    iterations: int
    reached: bool
    area: float
    over_before: float
    over_after: float
    worst_before_deg: float
    worst_after_deg: float
    volume_change: float
    mean_displacement: float
    max_displacement: float
    inverted: int

    @property
    def remaining(self) -> float:
        """Area over the limit, after over before; 0 if there was none."""
        return self.over_after / self.over_before if self.over_before else 0.0


@checks_kinds
def relax_overhang(
    surface: trimesh.Trimesh,
    limit_deg: float,
    strength: float = 10.0,
    locked: npt.ArrayLike | None = None,
    *,
    planes: PlaneStack | None = None,
    side: FacingSide = "below",
    walls: float | None = None,
    keep_volume: bool = True,
    tolerance: float = 0.02,
    rounds: int = 16,
    progress: Callable[[float], None] | None = None,
) -> OverhangRelaxation:
    """Deform a surface until its overhang keeps a limit (seed paper, Section 3.2).

    The angle of overhang of a face is the angle between its normal and the layer plane there; its tangent is the
    local overhang d/t of a toolpath along the surface. The build direction of rotary layers turns along the part: it
    is taken at each face's middle, and anew in each round as the face moves.

    What `surface_overhang` says of the faces that are not locked is what counts. The bed is the base of the planes,
    by default the height of the lowest vertex. No vertex goes below it, and one that was below goes no lower; what is
    or comes on it stays on it, though it may slide, and is carried. With side "both", flat tops in the highest layer
    plane stay flat; ledges, level faces that look up further down, count but are not pulled: lock them, or live with
    them.

    Args:
        surface: closed or open, consistently oriented, normals outwards, in mm. It can bend only where it has
            vertices: its edges should be well below the size of what overhangs.
        limit_deg: greatest angle of overhang θ, degrees; the tangent of it is the limit of d/t.
        strength: λ, weight of the normals against the shape: a higher one gets to the limit in fewer rounds of more
            steps, and leaves the shape less choice.
        locked: vertices that stay, as flags (n,) or indices (see `lock_base` and its like), at least one; by default
            those on the bed.
        planes: of the layers; by default horizontal.
        side: "below", the default, counts faces that lean outwards over air, as in a solid; "both" also those that
            lean inwards, as for a part printed as a single bead along its surface.
        walls: material up to this thickness is kept as a wall, its sides tied together, mm; by default 5 % of
            the part's diagonal; 0 ties nothing.
        keep_volume: hold the enclosed volume; only for closed surfaces.
        tolerance: share of the area over the limit that may be left, above 0 and below 1.
        rounds: greatest number of times that the aims change.
        progress: told the share done, 0 to 1.

    Raises:
        SurfaceError: a limit not between 0 and 90, a strength not above 0, a tolerance not between 0 and 1, an unknown
            side, locks that fit no vertex, no vertex to lock, a surface that is empty, not manifold, inside out, or
            has vertices of no face.
    """
    closed = _check(surface, limit_deg, strength, tolerance, rounds, walls)
    check_side(side)
    vertices = np.array(surface.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(surface.faces, dtype=np.int64)
    fixed = lock_base(surface, planes) if locked is None else as_flags(locked, len(vertices))
    if not fixed.any():
        raise SurfaceError(
            "no vertex is locked: a surface is relaxed from where it stands; "
            + ("no vertex lies on the bed, so choose locks" if locked is None else "choose at least one")
        )
    limit = math.radians(limit_deg)
    judge = Judge(vertices, faces, fixed, planes, limit, side == "both")
    before = judge(vertices)
    if before.over_pulled == 0.0 or fixed.all():
        return _result(surface, surface, judge, 0, 0, tolerance)
    thickest = 0.05 * float(np.linalg.norm(np.ptp(vertices, axis=0))) if walls is None else walls
    flat = _flat_top(vertices, faces, fixed, planes, before.tops)
    shape = RigidShape(vertices, faces, ~fixed, thickest, keep_volume and closed, flat)
    problem = _Problem(shape, strength, side == "both", judge.up(vertices), before.pulled)
    bed = Plane.horizontal(float(vertices[:, 2].min())) if planes is None else planes.base
    contact = Contact(vertices, ~fixed, bed, flat)
    search = QuasiNewton(problem.evaluate, shape.precondition, problem.start(before.angle), contact)
    best, best_over, waited = vertices, before.over_pulled, 0
    margin = _MARGIN
    own = np.zeros(len(faces))
    for done in range(rounds):
        problem.aim = np.maximum(limit - margin - own, 0.0)
        search.run(_STEPS, _SETTLED)
        now = shape.full(search.point)
        found = judge(now)
        waited = 0 if found.over_pulled < 0.95 * best_over else waited + 1
        if found.over_pulled < best_over:
            best, best_over = now, found.over_pulled
        if progress is not None:
            progress((done + 1.0) / rounds)
        if best_over <= tolerance * before.over_pulled or waited >= _PATIENCE:
            break
        problem.up = judge.up(now)
        problem.pull(found.pulled)
        own = np.clip(own + found.angle - (limit - margin), 0.0, _FARTHEST)
        margin = min(margin + _WIDER, _WIDEST)
    best, inverted = turned_back(
        vertices, best, faces, ~fixed, lambda moved: shape.full(contact.onto(shape.part(moved)))
    )
    if progress is not None:
        progress(1.0)
    return _result(surface, make_surface(best, faces), judge, search.steps, inverted, tolerance)


def _flat_top(
    vertices: Array, faces: Faces, fixed: Flags, planes: PlaneStack | None, tops: Flags
) -> FlatTop | None:
    """What holds the faces of flat tops (m,) in their plane; that of rotary layers or between locks stays in place."""
    top = np.zeros(len(vertices), dtype=bool)
    top[faces[tops]] = True
    if not (top & ~fixed).any():
        return None
    middle = vertices[top].mean(axis=0)
    up = UP if planes is None else build_directions(middle[None], planes)[0]
    normal = mean_normal(vertices, faces[tops], up)
    stays = bool((fixed & top).any()) or (planes is not None and planes.axis is not None)
    return FlatTop(top, normal, float(middle @ normal) if stays else None)


class _Problem:
    """The energy to minimise, for the aims and build directions of a round."""

    def __init__(self, shape: RigidShape, strength: float, both: bool, up: Array, pulled: Flags) -> None:
        self.up, self.aim = up, np.zeros(len(pulled))
        self._shape, self._strength, self._both = shape, strength, both
        self._angle, self._area = np.empty(len(pulled)), np.empty(len(pulled))
        self.pull(pulled)

    def pull(self, pulled: Flags) -> None:
        """From now on, pull these faces only."""
        self._weight = np.where(pulled, self._strength * self._shape.areas, 0.0)

    def evaluate(self, point: Array) -> tuple[float, Array]:
        vertices = self._shape.full(point)
        gradient = np.zeros_like(vertices)
        energy = self._shape.energy(vertices, gradient)
        energy += normal_energy(
            vertices,
            self._shape.faces,
            self._weight,
            self.up,
            self.aim,
            self._both,
            gradient,
            self._angle,
            self._area,
        )
        return energy, self._shape.part(gradient)

    def start(self, angle: Array) -> Array:
        """The free vertices to start from: as they are, but for level ceilings.

        A level face may lean any way, so none pulls it. Ceilings are lifted a little, most in their middle, as a
        membrane would be: then each part leans towards the nearest side that holds it.
        """
        vertices, faces = self._shape.vertices, self._shape.faces
        level = (self._weight > 0.0) & (angle > _LEVEL)
        start = self._shape.part(vertices)
        if not level.any():
            return start
        push = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(push, faces[level, corner], self._shape.areas[level, None] * self.up[level])
        lifted = self._shape.full(start + self._shape.precondition(self._shape.part(push))) - vertices
        edges = np.linalg.norm(face_edges(vertices, faces), axis=2)
        tilt = np.linalg.norm(face_edges(lifted, faces), axis=2) / np.maximum(edges, 1e-300)
        return start + (_LIFT / max(float(tilt.max()), 1e-300)) * self._shape.part(lifted)


def _check(
    surface: trimesh.Trimesh,
    limit_deg: float,
    strength: float,
    tolerance: float,
    rounds: int,
    walls: float | None,
) -> bool:
    """Refuse what cannot be relaxed; True if the surface is closed."""
    if not 0.0 < limit_deg < 90.0:
        raise SurfaceError(f"the limit of overhang must be between 0° and 90°, not {limit_deg}")
    if not (strength > 0.0 and math.isfinite(strength)):
        raise SurfaceError(f"the strength must be a number above 0, not {strength}")
    if not 0.0 < tolerance < 1.0:
        raise SurfaceError(f"the share of overhang that may be left must be between 0 and 1, not {tolerance}")
    if rounds < 1 or rounds != int(rounds):
        raise SurfaceError(f"relaxation needs at least one round, and whole ones, not {rounds}")
    if walls is not None and not (walls >= 0.0 and math.isfinite(walls)):
        raise SurfaceError(f"the thickness up to which walls are kept must be 0 mm or more, not {walls}")
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.faces, dtype=np.int64)
    if len(faces) == 0:
        raise SurfaceError("the surface has no faces: there is nothing to relax")
    if not np.isfinite(vertices).all():
        raise SurfaceError("the surface has a vertex that is not a finite point; repair it first")
    unused = np.setdiff1d(np.arange(len(vertices)), faces)
    if len(unused):
        raise SurfaceError(
            f"{len(unused)} vertices belong to no face, the first is vertex {unused[0]}; remove them first"
        )
    unsealed, crowded, twisted = edge_faults(faces)
    if len(crowded) or len(twisted):
        place = middle_of(vertices, crowded[0] if len(crowded) else twisted[0])
        raise SurfaceError(
            f"the surface is not a consistently oriented manifold: an edge at {place} has more than two faces, or "
            "two that turn the same way; repair it first"
        )
    if len(unsealed):
        return False
    if signed_volume(surface) <= 0.0:
        raise SurfaceError(
            "the surface is closed, but inside out or without a volume: its normals must point outwards; flip all faces"
        )
    return True


def _result(
    surface: trimesh.Trimesh,
    relaxed: trimesh.Trimesh,
    judge: Judge,
    iterations: int,
    inverted: int,
    tolerance: float,
) -> OverhangRelaxation:
    old, new = np.asarray(surface.vertices), np.asarray(relaxed.vertices)
    before, after = judge(np.array(old, dtype=np.float64)), judge(np.array(new, dtype=np.float64))
    volume = signed_volume(surface)
    moved = np.linalg.norm(new - old, axis=1)
    return OverhangRelaxation(
        surface=relaxed,
        iterations=iterations,
        reached=after.over <= tolerance * before.over,
        area=before.area,
        over_before=before.over,
        over_after=after.over,
        worst_before_deg=math.degrees(before.worst),
        worst_after_deg=math.degrees(after.worst),
        volume_change=(signed_volume(relaxed) - volume) / volume if volume else 0.0,
        mean_displacement=float(moved.mean()),
        max_displacement=float(moved.max()),
        inverted=inverted,
    )
