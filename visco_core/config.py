"""Every setting of a reconstruction: its type, default, range, unit and help, said once.

The command line's ``--set``, the service's ``/v1/options`` and the dashboard's form are all made
from these dataclasses. A value of None means that the profile, or the scan, decides.
"""

from __future__ import annotations

import dataclasses
import difflib
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from visco_core.errors import InputError

Profile = Literal["fast", "paper"]
Device = Literal["auto", "cpu", "cuda"]


def option(
    default: Any,
    help: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    unit: str = "",
    expert: bool = True,
    scale: Literal["linear", "log"] = "linear",
) -> Any:
    """A dataclass field that knows how to describe and check itself."""
    info = {
        "help": help,
        "minimum": minimum,
        "maximum": maximum,
        "unit": unit,
        "expert": expert,
        "scale": scale,
    }
    return field(default=default, metadata=info)


class _Checked:
    """Checks every field against its annotation and range when the record is built."""

    def __post_init__(self) -> None:
        hints = typing.get_type_hints(type(self))
        for spec in dataclasses.fields(self):  # type: ignore[arg-type]
            if "help" in spec.metadata:
                value = _checked(
                    spec.name, hints[spec.name], getattr(self, spec.name), spec.metadata
                )
                object.__setattr__(self, spec.name, value)


@dataclass(frozen=True)
class LossWeights(_Checked):
    """Weights of the four losses and the two lengths in them (paper, equation 9).

    Defaults of None are the profile's: the paper's λp = 0.1, λn = 1e-5, λv = 1e-4, λc = 1e-6 for
    ``paper``; for ``fast`` see ``visco_core.presets``. The paper does not give β.
    """

    point: float | None = option(
        None, "Weight λp of the point loss.", minimum=0.0, maximum=1e3, scale="log"
    )
    normal: float | None = option(
        None, "Weight λn of the normal loss.", minimum=0.0, maximum=1e3, scale="log"
    )
    viscosity: float | None = option(
        None,
        "Weight λv of the viscosity loss: larger is smoother and follows noisy points less.",
        minimum=1e-12,
        maximum=1e3,
        scale="log",
        expert=False,
    )
    coarea: float | None = option(
        None,
        "Weight λc of the coarea loss: larger closes holes with less surface.",
        minimum=0.0,
        maximum=1e3,
        scale="log",
    )
    viscosity_epsilon: float | None = option(
        None,
        "Viscosity ε: how strongly curvature is damped.",
        minimum=1e-6,
        maximum=1.0,
        scale="log",
    )
    coarea_beta: float | None = option(
        None,
        "Width β of the coarea loss's Laplace density.",
        minimum=1e-4,
        maximum=1.0,
        unit="unit cube",
        scale="log",
    )


@dataclass(frozen=True)
class LevelSchedule(_Checked):
    """How long each level of the grid is worked on.

    ``outer_steps`` and ``inner_steps`` belong to Gauss-Newton; the rest is the paper's Adam.
    Tuples have one entry a level, coarsest first; a shorter one repeats its last entry.
    """

    outer_steps: tuple[int, ...] | None = option(
        None, "Gauss-Newton steps on each level.", minimum=1, maximum=1000
    )
    inner_steps: tuple[int, ...] | None = option(
        None, "Conjugate-gradient iterations in each Gauss-Newton step.", minimum=1, maximum=10000
    )
    band_width: float | None = option(
        None,
        "Half width of the narrow band above the coarsest level.",
        minimum=2.0,
        maximum=32.0,
        unit="voxel",
    )
    paper_minutes: Literal[8, 15, 21, 30] = option(
        30, "Which of the paper's schedules the paper profile follows.", unit="min"
    )
    epochs: tuple[int, ...] | None = option(
        None, "Epochs on each level of the paper profile.", minimum=1, maximum=1000
    )
    iterations: int = option(
        12800, "Adam iterations in an epoch of the paper profile.", minimum=1, maximum=1_000_000
    )
    batch_fraction: float = option(
        0.1, "Share of the active voxels that an Adam iteration samples.", minimum=1e-4, maximum=1.0
    )
    learning_rate: float = option(
        1e-3, "Adam learning rate.", minimum=1e-7, maximum=1.0, scale="log"
    )
    prune: float | None = option(
        None,
        "Nodes farther than this from the surface are dropped when the paper profile refines.",
        minimum=2.0,
        maximum=1024.0,
        unit="voxel",
    )


@dataclass(frozen=True)
class Budget(_Checked):
    """What a reconstruction may cost."""

    seconds: float | None = option(
        None,
        "Wall-clock limit, reading included; the finest level finished by then comes back.",
        minimum=1.0,
        maximum=3600.0,
        unit="s",
        expert=False,
    )
    memory_bytes: int | None = option(
        None, "Memory limit; levels that would not fit are not begun.", minimum=1, unit="B"
    )


@dataclass(frozen=True)
class ReconstructionConfig(_Checked):
    """All settings of one reconstruction."""

    resolution: int = option(
        256,
        "Voxels along the longest axis of the finest grid.",
        minimum=64,
        maximum=1024,
        unit="voxel",
        expert=False,
    )
    profile: Profile = option(
        "fast", "fast: Gauss-Newton in seconds; paper: Adam as published.", expert=False
    )
    normals: Literal["use", "keep", "estimate", "ignore"] = option(
        "use",
        "use: the scan's normals, turned where their sides are clearly wrong, estimated where it "
        "has none; keep: the same, but never turned; estimate: always estimate; ignore: estimate "
        "for the start only and fit points alone.",
        expert=False,
    )
    trim: float | None = option(
        None,
        "Cut away surface farther than this from every point; leaves the mesh open there.",
        minimum=0.0,
        unit="scan unit",
        expert=False,
    )
    crop: tuple[float, ...] | None = option(
        None, "Keep only points inside this box: x0, y0, z0, x1, y1, z1.", unit="scan unit"
    )
    decimate: int | None = option(
        None,
        "Reduce the mesh to about this many triangles.",
        minimum=4,
        unit="triangle",
        expert=False,
    )
    up_axis: Literal["x", "y", "z"] = option(
        "z", "The scan's axis that points up; the GLB turns it to +Y.", expert=False
    )
    seed: int = option(0, "Seed of everything random.", minimum=0, maximum=2**31 - 1)
    weights: LossWeights = field(default_factory=LossWeights)
    schedule: LevelSchedule = field(default_factory=LevelSchedule)
    budget: Budget = field(default_factory=Budget)
    device: Device = "auto"
    backend: Literal["auto", "reference", "native"] = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.crop is not None:
            low, high = self.crop[:3], self.crop[3:]
            if len(self.crop) != 6 or not all(a < b for a, b in zip(low, high, strict=True)):
                raise InputError(
                    "invalid_option",
                    "crop needs six numbers, x0 y0 z0 x1 y1 z1, each low end below its high end.",
                )

    @classmethod
    def from_options(cls, options: Mapping[str, Any], **fixed: Any) -> ReconstructionConfig:
        """A config from flat option names, as ``describe_options`` lists them.

        ``fixed`` sets fields that are no options, such as ``device``. Raises InputError
        (``unknown_option``, ``invalid_option``) with one sentence that names the option.
        """
        homes = {described.name: described for described in describe_options()}
        values: dict[str, dict[str, Any]] = {}
        for name, value in options.items():
            if name not in homes:
                close = difflib.get_close_matches(name, homes, 1)
                hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(homes)}."
                raise InputError("unknown_option", f"There is no option {name!r}; {hint}")
            home = homes[name]
            info = {"minimum": home.minimum, "maximum": home.maximum}
            checked = _checked(name, home.annotation, value, info)
            values.setdefault(home.group, {})[home.attribute] = checked
        top = values.pop("", {})
        groups = {name: _GROUPS[name](**inner) for name, inner in values.items()}
        return cls(**{**top, **groups, **fixed})


_GROUPS: dict[str, type] = {"weights": LossWeights, "schedule": LevelSchedule, "budget": Budget}

_FLAT_NAMES = {
    ("weights", "point"): "lambda_p",
    ("weights", "normal"): "lambda_n",
    ("weights", "viscosity"): "lambda_v",
    ("weights", "coarea"): "lambda_c",
    ("budget", "seconds"): "budget_seconds",
    ("budget", "memory_bytes"): "max_memory_bytes",
}


@dataclass(frozen=True)
class OptionDescription:
    """One option as a user meets it: flat name, type, default, range, unit and help.

    ``type`` is one of ``integer``, ``number``, ``string``, ``integers``, ``numbers``;
    ``default`` None means that the profile or the scan decides.
    """

    name: str
    type: str
    default: Any
    nullable: bool
    choices: tuple[Any, ...] | None
    minimum: float | None
    maximum: float | None
    unit: str
    help: str
    expert: bool
    scale: str
    group: str
    attribute: str
    annotation: Any


def describe_options() -> tuple[OptionDescription, ...]:
    """Every option, in the order of a form: the plain ones of the top level first."""
    described = []
    for group, owner in {"": ReconstructionConfig, **_GROUPS}.items():
        hints = typing.get_type_hints(owner)
        for spec in dataclasses.fields(owner):
            if "help" not in spec.metadata:
                continue
            kind, nullable, choices = _kind(hints[spec.name])
            described.append(
                OptionDescription(
                    name=_FLAT_NAMES.get((group, spec.name), spec.name),
                    type=kind,
                    default=spec.default,
                    nullable=nullable,
                    choices=choices,
                    group=group,
                    attribute=spec.name,
                    annotation=hints[spec.name],
                    **spec.metadata,
                )
            )
    return tuple(described)


def _kind(hint: Any) -> tuple[str, bool, tuple[Any, ...] | None]:
    """(type name, may be None, choices) of an annotation."""
    nullable = False
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        inner = [arg for arg in typing.get_args(hint) if arg is not type(None)]
        nullable, hint = True, inner[0]
    if typing.get_origin(hint) is Literal:
        choices = typing.get_args(hint)
        return ("integer" if isinstance(choices[0], int) else "string"), nullable, choices
    if typing.get_origin(hint) is tuple:
        return ("integers" if typing.get_args(hint)[0] is int else "numbers"), nullable, None
    return {int: "integer", float: "number", str: "string"}[hint], nullable, None


def _checked(name: str, hint: Any, value: Any, info: Mapping[str, Any]) -> Any:
    """``value`` as the annotated type, or InputError with a sentence that names the option."""
    kind, nullable, choices = _kind(hint)
    if value is None:
        if nullable:
            return None
        raise _invalid(name, "needs a value.")
    if choices is not None:
        if value not in choices or isinstance(value, bool):
            raise _invalid(name, f"must be one of {', '.join(map(str, choices))}, not {value!r}.")
        return value
    if kind in ("integers", "numbers"):
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            raise _invalid(name, f"needs a list of {kind}, not {value!r}.")
        items = tuple(_number(name, item, kind == "integers", info) for item in value)
        if not items:
            raise _invalid(name, "needs at least one entry.")
        return items
    return _number(name, value, kind == "integer", info)


def _number(name: str, value: Any, whole: bool, info: Mapping[str, Any]) -> int | float:
    wanted = "a whole number" if whole else "a number"
    # Not isfinite, which raises for whole numbers too large for a float.
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 1e300:
        raise _invalid(name, f"needs {wanted}, not {value!r}.")
    if whole and value != int(value):
        raise _invalid(name, f"needs {wanted}, not {value!r}.")
    low, high = info["minimum"], info["maximum"]
    if (low is not None and value < low) or (high is not None and value > high):
        bounds = f"at least {low:g}" if high is None else f"between {low:g} and {high:g}"
        raise _invalid(name, f"must be {bounds}, not {value!r}.")
    return int(value) if whole else float(value)


def _invalid(name: str, rest: str) -> InputError:
    return InputError("invalid_option", f"{name} {rest}")
