/** All settings: those that everybody meets first, the experts' folded away. */
import { arrange, type Draft } from "../logic/form";
import { options } from "../state/options";
import { OptionField } from "./OptionField";

interface Props {
  draft: Draft;
  errors: Record<string, string>;
  onChange(draft: Draft): void;
}

export function SettingsForm({ draft, errors, onChange }: Props) {
  if (options.value.length === 0) return <p class="muted">Loading the settings…</p>;
  const { basic, expert } = arrange(options.value);
  const hiddenErrors = expert.some((group) => group.options.some((option) => errors[option.name]));
  const changed = expert.flatMap((group) => group.options).filter((one) => draft[one.name]?.length);
  const field = (option: (typeof basic)[number]) => (
    <OptionField
      key={option.name}
      option={option}
      raw={draft[option.name]}
      error={errors[option.name]}
      onChange={(raw) => onChange({ ...draft, [option.name]: raw })}
    />
  );
  return (
    <div class="stack">
      <div class="fields">{basic.map(field)}</div>
      <details class="expert" open={hiddenErrors || undefined}>
        <summary>
          Expert settings {changed.length > 0 && <span class="muted">({changed.length} changed)</span>}
        </summary>
        {expert.map((group) => (
          <section key={group.title}>
            <h3>{group.title}</h3>
            <div class="fields">{group.options.map(field)}</div>
          </section>
        ))}
      </details>
    </div>
  );
}
