"""What a job may be asked for: the core's options and the service's own, described once.

``JobParams`` is made from the descriptions, so that the checks, ``/v1/options`` and the OpenAPI
schema cannot disagree.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
)

from service.errors import FieldError, ServiceError
from service.jobs.model import PRIORITIES
from visco_core.config import OptionDescription, ReconstructionConfig, describe_options
from visco_core.errors import InputError

ARTIFACTS = ("mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt")
# These two are small and tell why a job ended as it did, so they are always kept.
ALWAYS_STORED = ("report.json", "log.txt")


def _own(name: str, type: str, default: Any, help: str, **more: Any) -> OptionDescription:
    blank = {
        "nullable": default is None,
        "choices": None,
        "minimum": None,
        "maximum": None,
        "unit": "",
        "expert": False,
        "scale": "linear",
        "group": "job",
        "attribute": name,
        "annotation": None,
    }
    return OptionDescription(name=name, type=type, default=default, help=help, **{**blank, **more})


JOB_OPTIONS: tuple[OptionDescription, ...] = (
    _own(
        "outputs",
        "strings",
        ARTIFACTS[:3],
        "Which files to make; report.json and log.txt are always there.",
        choices=ARTIFACTS,
    ),
    _own("label", "string", None, "A name for the job, to find it again.", maximum=200),
    _own(
        "priority", "string", "normal", "Which jobs of a queue are taken first.", choices=PRIORITIES
    ),
    _own(
        "device",
        "string",
        "auto",
        "Which workers may take the job; auto: a CUDA worker if there is one.",
        choices=("auto", "cpu", "cuda"),
        expert=True,
    ),
    _own(
        "callback_url",
        "string",
        None,
        "Address that is told when the job ends, signed by Standard Webhooks.",
        maximum=2000,
        expert=True,
    ),
)
# What readers of the schema should know, but the checks say in words of their own.
_SCHEMA: Mapping[str, dict[str, Any]] = {
    "callback_url": {"format": "uri", "pattern": r"^https?://[^\s/?#@]+([/?#]\S*)?$"},
    "crop": {"minItems": 6, "maxItems": 6},
}
# The core takes no number beyond the first, and JSON's readers no whole number beyond the second.
_LARGEST, _LARGEST_WHOLE = 1e300, 2**53
JOB_OPTION_NAMES = frozenset(option.name for option in JOB_OPTIONS)


def _integral(value: Any) -> Any:
    """JSON knows one kind of number: 64.0 is an integer there."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def all_options() -> tuple[OptionDescription, ...]:
    """Every option in the order of a form."""
    return describe_options() + JOB_OPTIONS


def _annotation(option: OptionDescription) -> Any:
    if option.type == "strings":
        return list[Literal[option.choices]]  # type: ignore[valid-type]
    if option.choices is not None:
        return Literal[option.choices]  # type: ignore[valid-type]
    if option.type == "string":
        limit = None if option.maximum is None else int(option.maximum)
        return Annotated[str, Field(min_length=1, max_length=limit)]
    whole = option.type in ("integer", "integers")
    farthest = _LARGEST_WHOLE if whole else _LARGEST
    low = -farthest if option.minimum is None else option.minimum
    high = farthest if option.maximum is None else option.maximum
    bounds = Field(ge=low, le=high, allow_inf_nan=False)
    number = Annotated[int, bounds] if whole else Annotated[float, bounds]
    bounded = Annotated[number, BeforeValidator(_integral)] if whole else number
    if option.type in ("integers", "numbers"):
        return Annotated[list[bounded], Field(min_length=1, max_length=64)]  # type: ignore[valid-type]
    return bounded


def _field(option: OptionDescription) -> tuple[Any, Any]:
    annotation = _annotation(option)
    default = list(option.default) if isinstance(option.default, tuple) else option.default
    extra = {"x-unit": option.unit, "x-expert": option.expert, "x-scale": option.scale}
    extra |= _SCHEMA.get(option.name, {})
    return (
        annotation | None if option.nullable else annotation,
        Field(default, description=option.help, json_schema_extra=extra),
    )


JobParams: type[BaseModel] = create_model(
    "JobParams",
    __config__=ConfigDict(extra="forbid", strict=True),
    __doc__="Settings of a job; whatever is left out has the default that /v1/options tells.",
    **{option.name: _field(option) for option in all_options()},  # type: ignore[call-overload]
)


def parse_params(text: str | bytes) -> dict[str, Any]:
    """The given params, checked; raises ServiceError ``invalid_params`` with each field's path."""
    try:
        given = JobParams.model_validate_json(text).model_dump(exclude_unset=True)
    except ValidationError as error:
        raise refuse_params(error.errors(include_url=False)) from None
    return check_params(given)


def check_params(given: Mapping[str, Any]) -> dict[str, Any]:
    """What only the core can check, such as the order of a box's corners."""
    try:
        core_config(given)
    except InputError as error:
        name = error.detail.split()[0]
        path = f"params.{name}" if name in given else "params"
        raise _refusal([FieldError(path, error.detail)]) from None
    return dict(given)


def core_config(params: Mapping[str, Any], **fixed: Any) -> ReconstructionConfig:
    """The core's config of a job's params; ``fixed`` sets fields that are no options."""
    options = {name: value for name, value in params.items() if name not in JOB_OPTION_NAMES}
    return ReconstructionConfig.from_options(options, **fixed)


def wanted_outputs(params: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the artifacts that the job is to leave."""
    asked = params.get("outputs", JOB_OPTIONS[0].default)
    return tuple(name for name in ARTIFACTS if name in asked or name in ALWAYS_STORED)


def hard_limit_seconds(params: Mapping[str, Any], unbounded: float) -> float:
    """When an attempt is taken for hung: well after its budget, or after ``unbounded``."""
    budget = params.get("budget_seconds")
    return unbounded if budget is None else budget * 1.5 + 60


def refuse_params(items: Iterable[Mapping[str, Any]]) -> ServiceError:
    """``invalid_params`` for pydantic's errors, whose places are counted from the params."""
    return _refusal(
        [
            FieldError(".".join(["params", *map(str, item["loc"])]), _sentence(item))
            for item in items
        ]
    )


def _sentence(item: Mapping[str, Any]) -> str:
    if item["type"] == "extra_forbidden":
        return "There is no such parameter."
    return f"{item['msg']}."


def _refusal(errors: Sequence[FieldError]) -> ServiceError:
    first = errors[0]
    return ServiceError(
        "invalid_params",
        f"{first.path}: {first.detail} GET /v1/options lists every parameter with its range.",
        errors=errors,
    )
