/** Chooses the page. */
import { ComparePage } from "./pages/ComparePage";
import { JobPage } from "./pages/JobPage";
import { JobsPage } from "./pages/JobsPage";
import { NewPage } from "./pages/NewPage";
import { Heading } from "./parts/Heading";
import { Shell } from "./parts/Shell";
import { query, route } from "./state/route";
import { apiKey } from "./state/session";

export function App() {
  const now = route.value;
  return (
    <Shell wide={now.page === "job" || now.page === "compare"}>
      {now.page === "jobs" && <JobsPage />}
      {now.page === "new" && <NewPage key={query.value.toString()} />}
      {now.page === "job" && <JobPage key={now.id + apiKey.value} id={now.id} />}
      {now.page === "compare" && <ComparePage key={now.ids.join() + apiKey.value} ids={now.ids} />}
      {now.page === "missing" && <Missing />}
    </Shell>
  );
}

function Missing() {
  return (
    <div class="blank card">
      <Heading>There is nothing here</Heading>
      <p>The address is not one of this dashboard.</p>
      <a class="button primary" href="/">
        All jobs
      </a>
    </div>
  );
}
