import { describe, expect, it } from "vitest";
import { EventParser } from "../src/logic/sse";

const STREAM = 'retry: 1000\n\nevent: queued\ndata: {"attempt": 0}\nid: 1\n\n: ping\n\nid: 2\nevent: done\ndata: {"a":\ndata: 1}\n\n';
const EVENTS = [
  { id: 1, type: "queued", data: { attempt: 0 } },
  { id: 2, type: "done", data: { a: 1 } },
];

describe("a stream of events", () => {
  it("gives each event once its blank line has come", () => {
    const parser = new EventParser();
    expect(parser.feed(STREAM.slice(0, -1))).toEqual(EVENTS.slice(0, 1));
    expect(parser.feed("\n")).toEqual(EVENTS.slice(1));
  });

  it("may be cut anywhere", () => {
    const parser = new EventParser();
    expect([...STREAM].flatMap((letter) => parser.feed(letter))).toEqual(EVENTS);
  });
});
