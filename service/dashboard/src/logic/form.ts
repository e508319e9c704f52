/** The settings form: what was typed, turned into the params of a job and back. */
import type { Option, Params } from "../api/types";

/** What stands in each field; an empty field means the default. */
export type Draft = Readonly<Record<string, string | readonly string[]>>;

export interface Checked {
  params: Params;
  errors: Record<string, string>;
}

export type Parsed = { value: unknown } | { error: string } | "default";

export function parseField(option: Option, raw: string | readonly string[] | undefined): Parsed {
  if (raw === undefined || raw.length === 0) return "default";
  if (typeof raw !== "string") return chosen(option, raw);
  const text = raw.trim();
  if (text === "") return "default";
  if (option.type === "string") return parseText(option, text);
  if (option.type === "integers" || option.type === "numbers") return parseList(option, text);
  return parseNumber(option, text);
}

function chosen(option: Option, raw: readonly string[]): Parsed {
  const fallback = (option.default ?? []) as string[];
  const same = raw.length === fallback.length && raw.every((one) => fallback.includes(one));
  return same ? "default" : { value: [...raw] };
}

function parseText(option: Option, text: string): Parsed {
  if (option.choices && !option.choices.includes(text)) {
    return { error: `Choose one of ${option.choices.join(", ")}.` };
  }
  if (option.maximum !== null && text.length > option.maximum) {
    return { error: `Use at most ${option.maximum} characters.` };
  }
  return { value: text };
}

function parseNumber(option: Option, text: string): Parsed {
  // Number() takes "0x10" and "1_0" is NaN; only plain decimals are meant here.
  const value = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(text) ? Number(text) : Number.NaN;
  if (!Number.isFinite(value)) return { error: "Type a number." };
  const whole = option.type === "integer" || option.type === "integers";
  if (whole && !Number.isInteger(value)) return { error: "Type a whole number." };
  if (option.choices && !option.choices.includes(value)) {
    return { error: `Choose one of ${option.choices.join(", ")}.` };
  }
  const { minimum, maximum } = option;
  if ((minimum !== null && value < minimum) || (maximum !== null && value > maximum)) {
    return { error: rangeText(option) };
  }
  return { value };
}

function parseList(option: Option, text: string): Parsed {
  const values: unknown[] = [];
  for (const part of text.split(/[\s,;]+/).filter(Boolean)) {
    const parsed = parseNumber(option, part);
    if (parsed === "default" || "error" in parsed) {
      return parsed === "default" ? parsed : { error: `${parsed.error} “${part}” is none.` };
    }
    values.push(parsed.value);
  }
  if (option.name === "crop") return cropBox(values as number[]);
  return { value: values };
}

function cropBox(values: number[]): Parsed {
  const ordered = [0, 1, 2].every((axis) => values[axis]! < values[axis + 3]!);
  if (values.length === 6 && ordered) return { value: values };
  return { error: "Type six numbers, x0 y0 z0 x1 y1 z1, each low end below its high end." };
}

export function rangeText({ minimum, maximum }: Option): string {
  if (minimum !== null && maximum !== null) return `Between ${minimum} and ${maximum}.`;
  if (minimum !== null) return `At least ${minimum}.`;
  return maximum === null ? "" : `At most ${maximum}.`;
}

export function checkDraft(options: readonly Option[], draft: Draft): Checked {
  const params: Params = {};
  const errors: Record<string, string> = {};
  for (const option of options) {
    const parsed = parseField(option, draft[option.name]);
    if (parsed === "default") continue;
    if ("error" in parsed) errors[option.name] = parsed.error;
    else if (!sameValue(parsed.value, option.default)) params[option.name] = parsed.value;
  }
  return { params, errors };
}

export function draftOf(options: readonly Option[], params: Params): Draft {
  const draft: Record<string, string | readonly string[]> = {};
  for (const option of options) {
    const value = params[option.name];
    if (value === undefined || value === null) continue;
    if (option.type === "strings") draft[option.name] = value as string[];
    else draft[option.name] = Array.isArray(value) ? value.join(" ") : String(value);
  }
  return draft;
}

/**
 * What to send to /retry, which merges: settings of the old job that went back to their default
 * are named with it.
 */
export function retryChanges(options: readonly Option[], old: Params, wanted: Params): Params {
  const changes: Params = { ...wanted };
  for (const option of options) {
    if (option.name in old && !(option.name in wanted)) changes[option.name] = option.default;
  }
  return changes;
}

/** Names of fields in the server's refusal, such as `params.resolution`, with its sentences. */
export function serverErrors(fields: ReadonlyArray<{ path: string; detail: string }>) {
  const errors: Record<string, string> = {};
  for (const { path, detail } of fields) {
    const name = path.split(".").slice(1)[0];
    if (name) errors[name] = detail;
  }
  return errors;
}

export function sameValue(a: unknown, b: unknown): boolean {
  return JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
}

export interface Group {
  title: string;
  options: Option[];
}

const GROUP_TITLES: Record<string, string> = {
  "": "Scan and mesh",
  weights: "Loss weights",
  schedule: "Schedule",
  budget: "Limits",
  job: "Job",
};

/** The options that everybody meets, and the experts' in groups. */
export function arrange(options: readonly Option[]): { basic: Option[]; expert: Group[] } {
  const groups = new Map<string, Option[]>();
  for (const option of options.filter((one) => one.expert)) {
    groups.set(option.group, [...(groups.get(option.group) ?? []), option]);
  }
  const expert = [...groups].map(([name, members]) => ({
    title: GROUP_TITLES[name] ?? name,
    options: members,
  }));
  const basic = options.filter((one) => !one.expert);
  const first = basic.filter((one) => one.name === "label");
  return { basic: [...first, ...basic.filter((one) => one.name !== "label")], expert };
}

const FIELD_NAMES: Record<string, string> = {
  budget_seconds: "Time budget",
  max_memory_bytes: "Memory limit",
  up_axis: "Up axis",
  callback_url: "Callback address",
  lambda_p: "λp, points",
  lambda_n: "λn, normals",
  lambda_v: "λv, viscosity",
  lambda_c: "λc, coarea",
  viscosity_epsilon: "ε, viscosity",
  coarea_beta: "β, coarea",
};

export function fieldName(name: string): string {
  const known = FIELD_NAMES[name];
  if (known) return known;
  const words = name.replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

export function defaultText(option: Option): string {
  if (option.default === null || option.default === undefined) {
    return option.group === "weights" || option.group === "schedule" ? "automatic" : "none";
  }
  return Array.isArray(option.default) ? option.default.join(" ") : String(option.default);
}
