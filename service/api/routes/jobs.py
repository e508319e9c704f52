"""Submitting, listing, cancelling, retrying and deleting jobs."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.container import Services
from service.api.deps import Reader, ServicesDep, Writer
from service.api.multipart import SubmissionForm, SubmissionReader
from service.api.responses import COMMON, problems
from service.api.schemas import JobBody, JobPageBody
from service.auth.principal import Principal
from service.errors import ServiceError
from service.jobs.params import JobParams, parse_params
from service.jobs.queries import JobFilter
from service.jobs.state import Status
from service.jobs.submission import Accepted, Submission
from service.uploads.inspection import Length
from service.uploads.received import ReceivedFile
from service.webhooks.target import check_callback

router = APIRouter(prefix="/jobs", tags=["jobs"])

_MORE_BYTES = 1 << 19
JobId = Annotated[str, "The id of a job."]
IdempotencyKey = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=255,
        description="The same key and body give the same job for 24 hours.",
    ),
]
_SUBMISSION = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "description": "Either `file` or `upload_id`, and `params`.",
                    "additionalProperties": False,
                    "properties": {
                        "file": {
                            "type": "string",
                            "format": "binary",
                            "description": "PLY, XYZ, PTS, OBJ, STL, PCD, LAS, LAZ, E57 or NPZ.",
                        },
                        "upload_id": {"type": "string", "description": "A complete upload."},
                        "params": {"$ref": "#/components/schemas/JobParams"},
                    },
                },
                "encoding": {"params": {"contentType": "application/json"}},
            }
        },
    }
}


@router.post(
    "",
    status_code=202,
    openapi_extra=_SUBMISSION,
    responses=problems(
        *COMMON,
        "bad_request",
        "upload_not_found",
        "idempotency_conflict",
        "upload_incomplete",
        "upload_expired",
        "too_large",
        "too_many_points",
        "not_a_point_cloud",
        "unsupported_media_type",
        "invalid_params",
        "callback_refused",
        "quota_queued",
        "storage_full",
        "quota_storage",
    ),
    operation_id="submit_job",
)
async def submit_job(
    request: Request,
    response: Response,
    principal: Writer,
    parts: ServicesDep,
    idempotency_key: IdempotencyKey = None,
) -> JobBody:
    """Submit a scan: as `file`, or as `upload_id` of a complete upload; with `params` as JSON."""
    declared = request.headers.get("content-length", "")
    if idempotency_key is None:
        await run_in_threadpool(parts.intake.check_quota, principal)
    # The body is as large as the file and a little more.
    length = Length(int(declared)) if declared.isdigit() else Length()
    least = max(0, (length.size or 0) - _MORE_BYTES)
    await run_in_threadpool(parts.uploads.check_room, principal, least)
    open_file = partial(parts.uploads.receive_scan, length=length)
    form = await SubmissionReader(request, open_file).read()
    accepted = await run_in_threadpool(_accept, parts, principal, form, idempotency_key)
    return await run_in_threadpool(_answer, parts, principal, accepted, response)


def _accept(
    parts: Services, principal: Principal, form: SubmissionForm, idempotency_key: str | None
) -> Accepted:
    file, upload_id = form.file, form.fields.get("upload_id")
    try:
        params = parse_params(form.fields.get("params", "{}"))
        check_callback(params.get("callback_url"), parts.settings.webhook_allow_private)
        if (file is None) == (upload_id is None):
            raise ServiceError("invalid_request", "Send either 'file' or 'upload_id'.")
        if file is not None:
            return _accept_file(parts, principal, params, file, idempotency_key)
        upload = parts.uploads.usable(principal, str(upload_id))
        submission = Submission(principal, params, upload.id, idempotency_key)
        return parts.intake.accept(submission, upload)
    finally:
        if file is not None:
            file.discard()


def _accept_file(
    parts: Services,
    principal: Principal,
    params: dict[str, Any],
    file: ReceivedFile,
    idempotency_key: str | None,
) -> Accepted:
    source = f"{file.name}:{file.sha256}"
    submission = Submission(principal, params, source, idempotency_key)
    earlier = parts.intake.replay(submission)
    if earlier is not None:
        return earlier
    parts.uploads.check_room(principal, file.size)
    upload = parts.uploads.keep(principal, file, parts.uploads.inspect(file))
    try:
        accepted = parts.intake.accept(submission, upload)
    except BaseException:
        parts.uploads.discard_bytes(upload)
        raise
    if accepted.replayed:
        parts.uploads.discard_bytes(upload)
    return accepted


@router.get("", responses=problems(*COMMON, "invalid_cursor"), operation_id="list_jobs")
def list_jobs(
    principal: Reader,
    parts: ServicesDep,
    status: Annotated[list[Status] | None, Query(description="May be given several times.")] = None,
    label: Annotated[str | None, Query(description="Exactly this label.")] = None,
    q: Annotated[str | None, Query(max_length=200, description="Part of label or name.")] = None,
    cursor: Annotated[
        str | None,
        Query(
            description="`next_cursor` of the page before.",
            json_schema_extra={"pattern": "^[0-9a-z]{26}$"},
        ),
    ] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> JobPageBody:
    """Jobs, newest first."""
    if cursor is not None and (len(cursor) != 26 or not cursor.isalnum() or not cursor.isascii()):
        raise ServiceError("invalid_cursor", "Send `next_cursor` of the page before, or none.")
    wanted = JobFilter(principal.visible_owner, status or (), label, q)
    jobs, positions = parts.jobs.page(wanted, cursor, limit + 1)
    more = len(jobs) > limit
    jobs = jobs[:limit]
    return JobPageBody(
        jobs=[JobBody.of(job, positions.get(job.id)) for job in jobs],
        next_cursor=jobs[-1].id if more else None,
    )


@router.get("/{job_id}", responses=problems(*COMMON, "job_not_found"), operation_id="get_job")
def get_job(job_id: JobId, principal: Reader, parts: ServicesDep) -> JobBody:
    """One job with its progress, attempts, timings and artifacts."""
    return JobBody.of(*parts.jobs.get(principal, job_id))


@router.post(
    "/{job_id}/cancel",
    status_code=202,
    responses=problems(*COMMON, "job_not_found", "job_finished"),
    operation_id="cancel_job",
)
def cancel_job(job_id: JobId, principal: Writer, parts: ServicesDep) -> JobBody:
    """Stop a job: a queued one ends at once, a running one within a second."""
    parts.jobs.cancel(principal, job_id)
    return JobBody.of(*parts.jobs.get(principal, job_id))


@router.post(
    "/{job_id}/retry",
    status_code=202,
    responses=problems(
        *COMMON,
        "bad_request",
        "job_not_found",
        "job_not_finished",
        "idempotency_conflict",
        "invalid_params",
        "callback_refused",
        "quota_queued",
    ),
    operation_id="retry_job",
)
def retry_job(
    job_id: JobId,
    response: Response,
    principal: Writer,
    parts: ServicesDep,
    params: Annotated[JobParams | None, Body()] = None,  # type: ignore[valid-type]
    idempotency_key: IdempotencyKey = None,
) -> JobBody:
    """A new job of the same scan; the given params replace those of the old one."""
    changes = {} if params is None else params.model_dump(exclude_unset=True)
    check_callback(changes.get("callback_url"), parts.settings.webhook_allow_private)
    accepted = parts.jobs.retry(principal, job_id, changes, idempotency_key)
    return _answer(parts, principal, accepted, response)


@router.delete(
    "/{job_id}",
    status_code=204,
    responses=problems(*COMMON, "job_not_found"),
    operation_id="delete_job",
)
def delete_job(job_id: JobId, principal: Writer, parts: ServicesDep) -> None:
    """Remove a job with its results, and its scan unless another job uses that too."""
    parts.jobs.delete(principal, job_id)


def _answer(
    parts: Services, principal: Principal, accepted: Accepted, response: Response
) -> JobBody:
    response.headers["Location"] = f"/v1/jobs/{accepted.job_id}"
    if accepted.replayed:
        response.headers["Idempotency-Replayed"] = "true"
    return JobBody.of(*parts.jobs.get(principal, accepted.job_id))
