"""What a job may be asked for."""

from __future__ import annotations

import json

import pytest

from service.errors import ServiceError
from service.jobs.params import (
    JobParams,
    all_options,
    core_config,
    hard_limit_seconds,
    parse_params,
    wanted_outputs,
)
from visco_core.config import ReconstructionConfig, describe_options


def refusal(**params: object) -> dict[str, str]:
    with pytest.raises(ServiceError) as caught:
        parse_params(json.dumps(params))
    assert caught.value.code == "invalid_params"
    return {error.path: error.detail for error in caught.value.errors}


def test_every_core_option_is_a_parameter_with_the_same_range() -> None:
    properties = JobParams.model_json_schema()["properties"]
    for option in describe_options():
        described = properties[option.name]
        assert described["description"] == option.help
        text = json.dumps(described)
        for bound, word in ((option.minimum, "minimum"), (option.maximum, "maximum")):
            assert (f'"{word}": {json.dumps(bound)}' in text) == (bound is not None), option.name


def test_the_default_of_every_option_is_accepted() -> None:
    for option in all_options():
        if option.default is not None or option.nullable:
            assert option.name in parse_params(json.dumps({option.name: option.default}))


def test_only_what_was_given_is_kept() -> None:
    assert parse_params('{"resolution": 128}') == {"resolution": 128}


def test_a_whole_number_may_be_written_with_a_point() -> None:
    params = parse_params('{"resolution": 128.0, "epochs": [2.0]}')
    assert params == {"resolution": 128, "epochs": [2]}
    assert all(isinstance(value, int) for value in (params["resolution"], *params["epochs"]))
    assert set(refusal(resolution=128.5, seed="1")) == {"params.resolution", "params.seed"}


def test_numbers_without_a_range_of_their_own_still_have_an_end() -> None:
    wrong = refusal(trim=1e301, decimate=2**54, max_memory_bytes=2**54)
    assert set(wrong) == {"params.trim", "params.decimate", "params.max_memory_bytes"}


def test_all_wrong_fields_are_named_at_once() -> None:
    wrong = refusal(resolution=63, lambda_v="big", outputs=["mesh.stl"], resolutoin=128)
    assert set(wrong) == {
        "params.resolution", "params.lambda_v", "params.outputs.0", "params.resolutoin",
    }  # fmt: skip


@pytest.mark.parametrize("text", ["", "[]", "null", "{", '{"resolution": NaN}', '"x"'])
def test_params_that_are_no_object_are_refused(text: str) -> None:
    with pytest.raises(ServiceError) as caught:
        parse_params(text)
    assert caught.value.code == "invalid_params"


def test_what_only_the_core_can_check_is_refused_under_its_name() -> None:
    assert set(refusal(crop=[0, 0, 0, 1, -1, 1])) == {"params.crop"}


def test_job_options_stay_away_from_the_core() -> None:
    params = parse_params('{"label": "a", "priority": "high", "budget_seconds": 5}')
    config = core_config(params, device="cpu")
    assert config.budget.seconds == 5
    assert config == ReconstructionConfig.from_options({"budget_seconds": 5}, device="cpu")


def test_report_and_log_are_always_wanted() -> None:
    assert wanted_outputs({"outputs": ["mesh.ply"]}) == ("mesh.ply", "report.json", "log.txt")


def test_the_hard_limit_lies_well_behind_the_budget() -> None:
    assert hard_limit_seconds({"budget_seconds": 10}, 1000.0) > 20
    assert hard_limit_seconds({}, 1000.0) == 1000.0
