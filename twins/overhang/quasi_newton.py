"""Minimising with a fixed preconditioner: L-BFGS whose first guess of the inverse Hessian is one prefactored matrix.

For an energy of edges, with its Laplacian as the preconditioner, the number of steps does not grow with the mesh
(Liu, Bouaziz & Kavan 2017). Bounds are kept by projection: what they hold takes no part in a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .contact import Contact

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_SUFFICIENT = 1e-4
"""Share of the promised decrease that a step must keep (Armijo)."""
_HALVINGS = 20


class QuasiNewton:
    """A minimisation that can be interrupted: the energy may change between runs, the curvature learned is kept."""

    def __init__(
        self,
        evaluate: Callable[[Array], tuple[float, Array]],
        precondition: Callable[[Array], Array],
        start: Array,
        contact: Contact | None = None,
        memory: int = 6,
    ) -> None:
        """Prepare to minimise from `start`.

        Args:
            evaluate: energy and its gradient, shape (n,), at a point, shape (n,); infinite where it may not go.
            precondition: an inverse Hessian, symmetric positive definite, applied to a gradient.
            start: shape (n,).
            contact: bounds on the point.
            memory: steps from which curvature is remembered.
        """
        self._evaluate, self._precondition, self._memory = evaluate, precondition, memory
        self._contact = contact
        self._pairs: list[tuple[Array, Array, float]] = []
        self.point = start.copy() if contact is None else contact.onto(start)
        self.steps = 0

    def run(self, steps: int, tolerance: float) -> bool:
        """At most so many steps down; True if the energy stopped falling, by more than `tolerance` of it a step."""
        energy, gradient = self._evaluate(self.point)
        for _ in range(steps):
            held = None if self._contact is None else self._contact.touching(self.point)
            direction = self._left(self._direction(self._left(gradient, held)), held)
            slope = _dot(gradient, direction)
            if slope >= 0.0 and self._pairs:
                self._pairs.clear()
                direction = self._left(self._direction(self._left(gradient, held)), held)
                slope = _dot(gradient, direction)
            if slope >= 0.0:
                return True
            found = self._step(energy, gradient, slope, direction)
            if found is None:
                if not self._pairs:
                    return True
                self._pairs.clear()
                continue
            point, lower, after = found
            self._remember(point - self.point, self._left(after - gradient, held))
            fall = energy - lower
            self.point, energy, gradient = point, lower, after
            self.steps += 1
            if fall <= tolerance * abs(energy):
                return True
        return False

    def _left(self, vector: Array, held: Flags | None) -> Array:
        return vector if self._contact is None or held is None else self._contact.along(vector, held)

    def _step(
        self, energy: float, gradient: Array, slope: float, direction: Array
    ) -> tuple[Array, float, Array] | None:
        length = 1.0
        for _ in range(_HALVINGS):
            point, promise = self.point + length * direction, length * slope
            if self._contact is not None:
                point = self._contact.onto(point)
                promise = _dot(gradient, point - self.point)
            after, rising = self._evaluate(point)
            if promise < 0.0 and after <= energy + _SUFFICIENT * promise:
                return point, after, rising
            if not math.isfinite(after) or promise >= 0.0:
                length *= 0.5
                continue
            # The least of the parabola through both energies and the slope.
            parabola = -0.5 * promise * length / max(after - energy - promise, 1e-300)
            length = min(max(parabola, 0.1 * length), 0.6 * length)
        return None

    def _direction(self, gradient: Array) -> Array:
        q = gradient.copy()
        shares = []
        for s, y, rho in reversed(self._pairs):
            share = rho * _dot(s, q)
            q -= share * y
            shares.append(share)
        d = self._precondition(q)
        for (s, y, rho), share in zip(self._pairs, reversed(shares), strict=True):
            d += (share - rho * _dot(y, d)) * s
        return -d

    def _remember(self, s: Array, y: Array) -> None:
        curvature = _dot(s, y)
        if curvature > 1e-10 * math.sqrt(_dot(s, s) * _dot(y, y)):
            self._pairs = [*self._pairs, (s, y, 1.0 / curvature)][-self._memory :]


def _dot(a: Array, b: Array) -> float:
    # Not BLAS: it shares even short vectors out among threads, which wait for each other on a busy machine.
    return float(np.einsum("i,i->", a, b))
