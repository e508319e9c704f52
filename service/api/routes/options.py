"""What a job can be asked for."""

from __future__ import annotations

from fastapi import APIRouter

from service.api.responses import problems
from service.api.schemas import OptionBody, OptionsBody
from service.jobs.params import all_options

router = APIRouter(tags=["service"])


@router.get("/options", responses=problems("bad_request"), operation_id="list_options")
def list_options() -> OptionsBody:
    """Every parameter of a job: type, default, range, unit and help, in the order of a form."""
    return OptionsBody(
        options=[OptionBody.model_validate(o, from_attributes=True) for o in all_options()]
    )
