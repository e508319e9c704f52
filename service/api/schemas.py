"""What the API gives, as types; the OpenAPI description is made from them."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.db import utc_now
from service.jobs.model import PRIORITIES, Artifact, Job, PriorityName
from service.jobs.state import AttemptOutcome, Status


class ProgressBody(BaseModel):
    """How far a running job is; see `fraction` for a bar and `losses` for a curve."""

    model_config = ConfigDict(extra="allow")

    phase: str = Field(examples=["solve"])
    fraction: float = Field(ge=0, le=1)
    elapsed_seconds: float
    remaining_seconds: float | None = Field(
        description="Until the job ends; None until the solve begins, a guess on its first level."
    )
    level: int
    levels: int
    resolution: int
    step: int
    steps: int
    losses: dict[str, float]


class ScanBody(BaseModel):
    """The scan that the job reads."""

    upload_id: str
    name: str
    size: int
    sha256: str | None
    points: int | None = Field(description="What the header declares, if the format counts.")


class AttemptBody(BaseModel):
    number: int
    worker: str
    device: str
    started_at: datetime
    finished_at: datetime | None
    outcome: AttemptOutcome | None = Field(description="None while it runs.")


class TimingsBody(BaseModel):
    queued_seconds: float
    running_seconds: float | None = Field(description="Of the latest attempt.")
    total_seconds: float


class PhaseBody(BaseModel):
    name: str
    seconds: float


class OutcomeBody(BaseModel):
    code: str = Field(examples=["complete", "budget_exhausted", "memory_limited"])
    message: str
    resolution: int


class ResultBody(BaseModel):
    """What came out, in short; report.json has the rest."""

    outcome: OutcomeBody
    vertices: int
    faces: int
    notes: list[str] = Field(default_factory=list)


class FailureBody(BaseModel):
    code: str = Field(examples=["worker_lost"])
    detail: str


class ArtifactBody(BaseModel):
    name: str = Field(examples=["mesh.glb"])
    size: int
    sha256: str
    content_type: str
    created_at: datetime
    url: str

    @classmethod
    def of(cls, artifact: Artifact) -> ArtifactBody:
        return cls(
            name=artifact.name,
            size=artifact.size,
            sha256=artifact.sha256,
            content_type=artifact.content_type,
            created_at=artifact.created_at,
            url=f"/v1/jobs/{artifact.job_id}/artifacts/{artifact.name}",
        )


class JobBody(BaseModel):
    """A job as its owner sees it."""

    id: str
    status: Status
    cancel_requested: bool
    label: str | None
    priority: PriorityName
    device_class: Literal["cpu", "cuda"]
    params: dict[str, Any] = Field(description="As given; /v1/options tells the defaults.")
    scan: ScanBody
    retry_of: str | None
    queue_position: int | None = Field(description="1 is taken next; None unless queued.")
    progress: ProgressBody | None
    attempts: list[AttemptBody]
    timings: TimingsBody
    phases: list[PhaseBody] = Field(description="What each phase of the last attempt cost.")
    result: ResultBody | None
    error: FailureBody | None
    artifacts: list[ArtifactBody]
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None

    @classmethod
    def of(cls, job: Job, queue_position: int | None) -> JobBody:
        result = job.result or {}
        return cls(
            id=job.id,
            status=job.status,
            cancel_requested=job.cancel_requested,
            label=job.label,
            priority=PRIORITIES[job.priority],
            device_class=job.device_class,  # type: ignore[arg-type]
            params=job.params,
            scan=_scan(job),
            retry_of=job.retry_of,
            queue_position=queue_position,
            progress=None if job.progress is None else ProgressBody(**job.progress),
            attempts=[AttemptBody.model_validate(a, from_attributes=True) for a in job.attempts],
            timings=_timings(job),
            phases=[PhaseBody(**phase) for phase in result.get("phases", ())],
            result=ResultBody(**result) if result else None,
            error=_failure(job),
            artifacts=[ArtifactBody.of(artifact) for artifact in job.artifacts],
            created_at=job.created_at,
            started_at=job.started_at,
            finished_at=job.finished_at,
        )


class JobPageBody(BaseModel):
    jobs: list[JobBody]
    next_cursor: str | None = Field(description="None on the last page.")


class ArtifactListBody(BaseModel):
    artifacts: list[ArtifactBody]


class UploadBody(BaseModel):
    id: str
    name: str
    size: int
    offset: int
    complete: bool
    points: int | None
    error: FailureBody | None = Field(description="Why a complete file is no scan.")
    expires_at: datetime


class OptionBody(BaseModel):
    """One parameter of a job."""

    name: str
    type: Literal["integer", "number", "string", "integers", "numbers", "strings"]
    default: Any = Field(description="None: the profile or the scan decides.")
    nullable: bool
    choices: list[str | int] | None
    minimum: float | None
    maximum: float | None
    unit: str
    help: str
    expert: bool
    scale: Literal["linear", "log"]
    group: str


class OptionsBody(BaseModel):
    options: list[OptionBody]


class WorkerBody(BaseModel):
    id: str
    device_class: str
    device: str
    queues: list[str]
    version: str
    started_at: datetime
    seen_at: datetime


class InfoBody(BaseModel):
    version: str
    workers: list[WorkerBody]
    queued: int
    running: int
    max_upload_bytes: int
    max_points: int
    keys_needed: bool


class FieldErrorBody(BaseModel):
    path: str = Field(examples=["params.resolution"])
    detail: str


class ProblemBody(BaseModel):
    """application/problem+json (RFC 9457)."""

    type: str = Field(examples=["urn:visco:problem:job_not_found"])
    title: str
    status: int
    code: str = Field(examples=["job_not_found"], description="Stable; docs/errors.md lists all.")
    detail: str = Field(description="One sentence that says what to do.")
    request_id: str
    errors: list[FieldErrorBody] | None = None


class HealthBody(BaseModel):
    status: Literal["ok"]


def _scan(job: Job) -> ScanBody:
    upload = job.upload
    return ScanBody(
        upload_id=upload.id,
        name=upload.name,
        size=upload.size,
        sha256=upload.sha256,
        points=upload.points,
    )


def _failure(job: Job) -> FailureBody | None:
    if job.error_code is None:
        return None
    return FailureBody(code=job.error_code, detail=job.error_detail or "")


def _timings(job: Job) -> TimingsBody:
    end = job.finished_at or utc_now()
    begun = job.started_at or end
    return TimingsBody(
        queued_seconds=(begun - job.created_at).total_seconds(),
        running_seconds=None if job.started_at is None else (end - begun).total_seconds(),
        total_seconds=(end - job.created_at).total_seconds(),
    )
