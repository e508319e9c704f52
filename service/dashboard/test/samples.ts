/** Small stand-ins for what the API gives. */
import type { Job, Option } from "../src/api/types";

export function option(fields: Partial<Option> & { name: string }): Option {
  return {
    type: "number",
    default: null,
    nullable: true,
    choices: null,
    minimum: null,
    maximum: null,
    unit: "",
    help: "",
    expert: false,
    scale: "linear",
    group: "",
    ...fields,
  };
}

export function job(id: string, fields: Partial<Job> = {}): Job {
  return {
    id,
    status: "succeeded",
    cancel_requested: false,
    label: null,
    priority: "normal",
    device_class: "cpu",
    params: {},
    scan: { upload_id: "u", name: `${id}.ply`, size: 1, sha256: "0", points: 10 },
    retry_of: null,
    queue_position: null,
    progress: null,
    attempts: [],
    timings: { queued_seconds: 0, running_seconds: 1, total_seconds: 1 },
    phases: [],
    result: null,
    error: null,
    artifacts: [],
    created_at: "2026-01-01T00:00:00Z",
    started_at: null,
    finished_at: null,
    ...fields,
  };
}

export function jobMap(...jobs: Job[]): Map<string, Job> {
  return new Map(jobs.map((one) => [one.id, one]));
}
