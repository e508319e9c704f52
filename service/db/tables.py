"""Imports every table, so that ``Base.metadata`` is complete."""

from service.auth.model import ApiKey
from service.db.base import Base
from service.jobs.model import Artifact, Attempt, Event, IdempotencyKey, Job, WorkerRecord
from service.uploads.model import Upload, UploadPart
from service.webhooks.model import Delivery, Secret

metadata = Base.metadata

__all__ = [
    "ApiKey",
    "Artifact",
    "Attempt",
    "Delivery",
    "Event",
    "IdempotencyKey",
    "Job",
    "Secret",
    "Upload",
    "UploadPart",
    "WorkerRecord",
    "metadata",
]
