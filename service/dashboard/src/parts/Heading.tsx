/** A page's name. After a move within the dashboard it takes the focus, so that it is read out. */
import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { takeArrival } from "../state/route";

export function Heading({ children, grow }: { children: ComponentChildren; grow?: boolean }) {
  const heading = useRef<HTMLHeadingElement>(null);
  useLayoutEffect(() => {
    if (takeArrival()) heading.current?.focus({ preventScroll: true });
  }, []);
  return (
    <h1 ref={heading} class={grow ? "grow" : ""} tabIndex={-1}>
      {children}
    </h1>
  );
}
