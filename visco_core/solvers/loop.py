"""One loop for every solver: an algorithm says how to begin, how to step and when it is done."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from visco_core.energy import Energy
from visco_core.kernels import Array


class Pace(Protocol):
    """What a solver asks of the clock; cheap enough for inner loops."""

    def check(self) -> None:
        """Raises Stopped when the caller wants to stop."""
        ...

    def late(self) -> bool:
        """Whether the time given to this level is used up."""
        ...


class State(Protocol):
    """What every solver's state shows.

    values (N + 1,); steps taken; ``work``, iterations over all nodes so far; weighted losses.
    """

    @property
    def values(self) -> Array: ...
    @property
    def steps(self) -> int: ...
    @property
    def work(self) -> int: ...
    @property
    def losses(self) -> dict[str, float]: ...


S = TypeVar("S", bound=State)


class Solver(Protocol[S]):
    """An algorithm that minimises the energy of one level.

    ``steps`` is how many steps it takes at most, ``work`` how many iterations over all nodes they
    cost. A step that finds its pace late ends early and is still a step downhill.
    """

    @property
    def steps(self) -> int: ...
    @property
    def work(self) -> int: ...
    def init(self, energy: Energy, values: Array) -> S: ...
    def step(self, energy: Energy, state: S, pace: Pace) -> S: ...
    def done(self, state: S) -> bool: ...


def minimise(
    solver: Solver[S],
    energy: Energy,
    values: Array,
    pace: Pace,
    report: Callable[[S], None],
) -> S:
    """Runs ``solver`` from ``values`` (N + 1,) and calls ``report`` after each step.

    Takes at least one step; ends when the solver is done or the pace is late.
    """
    state = solver.init(energy, values)
    pace.check()
    while True:
        state = solver.step(energy, state, pace)
        report(state)
        if solver.done(state) or pace.late():
            return state
