/** A name that somebody else chose: kept apart from the text around it, whichever way it is read. */
import { plainName } from "../logic/format";

export function Name({ children }: { children: string }) {
  return <bdi>{plainName(children)}</bdi>;
}
