/** Reads a stream of server-sent events piece by piece (WHATWG HTML, section 9.2.6). */
export interface ServerEvent {
  id: number;
  type: string;
  data: Record<string, unknown>;
}

export class EventParser {
  private rest = "";
  private id = 0;
  private type = "";
  private data: string[] = [];

  /** The events that are complete with this piece of text. */
  feed(text: string): ServerEvent[] {
    const lines = (this.rest + text).split(/\r\n|\n|\r/);
    this.rest = lines.pop() ?? "";
    return lines.flatMap((line) => this.line(line));
  }

  private line(line: string): ServerEvent[] {
    if (line === "") return this.dispatch();
    const colon = line.indexOf(":");
    if (colon === 0) return [];
    const field = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (field === "event") this.type = value;
    else if (field === "data") this.data.push(value);
    else if (field === "id" && /^\d+$/.test(value)) this.id = Number(value);
    return [];
  }

  private dispatch(): ServerEvent[] {
    const { type, data } = this;
    this.type = "";
    this.data = [];
    if (data.length === 0) return [];
    return [{ id: this.id, type: type || "message", data: JSON.parse(data.join("\n")) }];
  }
}
