/** The API's types under the names that the dashboard uses. */
import type { components } from "./schema";

type Schemas = components["schemas"];

export type Job = Schemas["JobBody"];
export type JobPage = Schemas["JobPageBody"];
export type Status = Job["status"];
export type Artifact = Schemas["ArtifactBody"];
export type Progress = Schemas["ProgressBody"];
export type Option = Schemas["OptionBody"];
export type Info = Schemas["InfoBody"];
export type Upload = Schemas["UploadBody"];
export type ProblemBody = Schemas["ProblemBody"];
export type Params = Record<string, unknown>;

export const TERMINAL: ReadonlySet<Status> = new Set<Status>(["succeeded", "failed", "cancelled"]);

export function isActive(job: Pick<Job, "status">): boolean {
  return !TERMINAL.has(job.status);
}
