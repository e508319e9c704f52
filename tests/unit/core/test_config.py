"""Settings are checked when they are built, and described well enough to make forms from."""

from __future__ import annotations

import dataclasses
import json
import re
from typing import Any

import pytest

from visco_core.config import (
    Budget,
    LevelSchedule,
    LossWeights,
    ReconstructionConfig,
    describe_options,
)
from visco_core.errors import InputError
from visco_core.presets import FAST_WEIGHTS, PAPER_EPOCHS, PAPER_PRUNE, PAPER_WEIGHTS, decide

OPTIONS = {option.name: option for option in describe_options()}


def from_options(**options: Any) -> ReconstructionConfig:
    return ReconstructionConfig.from_options(options)


def example(name: str) -> Any:
    """Some value within the range of an option."""
    option = OPTIONS[name]
    if option.choices is not None:
        return option.choices[-1]
    if name == "crop":
        return [0, 0, 0, 1, 2.5, 3]
    value = option.minimum if option.maximum is None else option.maximum
    value = 1.0 if value is None else value
    value = int(value) if option.type.startswith("integer") else value
    return [value, value] if option.type.endswith("s") else value


def test_defaults_are_a_fast_run_at_256() -> None:
    config = ReconstructionConfig()
    assert (config.resolution, config.profile, config.normals) == (256, "fast", "use")
    assert from_options() == config


def test_promised_options_exist() -> None:
    promised = """resolution budget_seconds profile lambda_p lambda_n lambda_v lambda_c
        viscosity_epsilon coarea_beta epochs iterations batch_fraction learning_rate prune normals
        trim crop decimate up_axis seed max_memory_bytes outer_steps inner_steps band_width"""
    assert set(promised.split()) <= OPTIONS.keys()


@pytest.mark.parametrize("name", OPTIONS)
def test_every_option_describes_itself_and_takes_its_own_bounds(name: str) -> None:
    option = OPTIONS[name]
    assert option.help.endswith(".")
    assert option.type in {"integer", "number", "string", "integers", "numbers"}
    assert option.nullable == (option.default is None)
    json.dumps([option.default, option.choices, option.minimum, option.maximum])
    config = from_options(**{name: example(name)})
    home = getattr(config, option.group) if option.group else config
    found = getattr(home, option.attribute)
    assert found == (tuple(example(name)) if option.type.endswith("s") else example(name))


@pytest.mark.parametrize("name", OPTIONS)
def test_every_option_refuses_what_is_out_of_range_or_of_another_kind(name: str) -> None:
    option = OPTIONS[name]
    wrong: list[Any] = [True, {}, "", float("nan"), float("inf"), [], ["x"], object(), 10**400]
    if option.type.startswith("integer") and option.choices is None:
        wrong.append([1.5] if option.type == "integers" else 1.5)
    for bound, step in ((option.minimum, -1), (option.maximum, 1)):
        if bound is not None:
            wrong.append([bound + step] if option.type.endswith("s") else bound + step)
    if not option.nullable:
        wrong.append(None)
    for value in wrong:
        with pytest.raises(InputError) as caught:
            from_options(**{name: value})
        assert caught.value.code == "invalid_option", value
        assert name in caught.value.detail
        assert re.fullmatch(r".+\.", caught.value.detail)


@pytest.mark.parametrize("name", [n for n, option in OPTIONS.items() if option.nullable])
def test_none_leaves_an_open_option_to_the_profile(name: str) -> None:
    assert from_options(**{name: None}) == ReconstructionConfig()


def test_an_unknown_option_is_refused_with_a_guess() -> None:
    with pytest.raises(InputError) as caught:
        from_options(lambda_viscosity=1.0, lamda_v=1.0)
    assert caught.value.code == "unknown_option"
    with pytest.raises(InputError, match="did you mean lambda_v"):
        from_options(lamda_v=1.0)
    with pytest.raises(InputError, match="resolution"):
        from_options(zzz=1.0)


def test_whole_numbers_may_come_as_floats_and_lists_become_tuples() -> None:
    config = from_options(resolution=128.0, epochs=[2, 1.0], lambda_v=1)
    assert config.resolution == 128
    assert isinstance(config.resolution, int)
    assert config.schedule.epochs == (2, 1)
    assert isinstance(config.weights.viscosity, float)


@pytest.mark.parametrize(
    "crop", [(0, 0, 0, 1, 1), (0, 0, 0, 1, 1, 0), (1, 0, 0, 0, 1, 1), (0,) * 6, (0,) * 7]
)
def test_a_crop_box_without_volume_is_refused(crop: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="crop needs six numbers"):
        ReconstructionConfig(crop=crop)


def test_records_cannot_be_changed_or_built_wrong() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        ReconstructionConfig().seed = 1  # type: ignore[misc]
    for wrong in (
        lambda: LossWeights(viscosity=0.0),
        lambda: LevelSchedule(outer_steps=(0,)),
        lambda: Budget(seconds=0.5),
        lambda: ReconstructionConfig(resolution=63),
    ):
        with pytest.raises(InputError):
            wrong()


def test_fixed_fields_are_no_options() -> None:
    config = ReconstructionConfig.from_options({}, device="cpu", backend="reference", threads=2)
    assert (config.device, config.backend, config.threads) == ("cpu", "reference", 2)
    assert not {"device", "backend", "threads"} & OPTIONS.keys()


def test_the_paper_profile_has_the_paper_s_settings() -> None:
    decided = decide(ReconstructionConfig(profile="paper"))
    assert decided.weights == (PAPER_WEIGHTS,)
    assert not decided.keeps
    (weights,) = decided.weights
    assert (weights.point, weights.normal, weights.viscosity) == (0.1, 1e-5, 1e-4)
    assert (weights.coarea, weights.viscosity_epsilon) == (1e-6, 1e-2)
    schedule = decided.schedule
    assert (schedule.iterations, schedule.batch_fraction) == (12800, 0.1)
    assert (schedule.learning_rate, schedule.epochs) == (1e-3, (5, 5, 3))


@pytest.mark.parametrize("minutes", [8, 15, 21, 30])
def test_paper_minutes_choose_epochs_and_pruning(minutes: Any) -> None:
    schedule = LevelSchedule(paper_minutes=minutes)
    decided = decide(ReconstructionConfig(profile="paper", schedule=schedule)).schedule
    assert decided.epochs == PAPER_EPOCHS[minutes]
    assert decided.band_width == PAPER_PRUNE[minutes]


def test_what_the_user_says_wins_over_the_profile() -> None:
    config = from_options(lambda_v=3e-3, outer_steps=[7], prune=9, band_width=5, epochs=[1])
    fast = decide(config)
    assert fast.weights == (dataclasses.replace(FAST_WEIGHTS, viscosity=3e-3),)
    assert (fast.schedule.outer_steps, fast.schedule.band_width) == ((7,), 5)
    paper = decide(dataclasses.replace(config, profile="paper"))
    assert (paper.schedule.epochs, paper.schedule.band_width) == ((1,), 9)
    assert paper.weights == (dataclasses.replace(PAPER_WEIGHTS, viscosity=3e-3),)


def test_a_weight_of_zero_is_kept() -> None:
    config = from_options(lambda_c=0, lambda_n=0, profile="paper")
    (weights,) = decide(config).weights
    assert (weights.coarea, weights.normal) == (0, 0)
