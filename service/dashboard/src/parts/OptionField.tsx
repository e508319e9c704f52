/** One setting: name, unit, input, help, and what is wrong with what was typed. */
import type { Option } from "../api/types";
import { defaultText, fieldName, rangeText } from "../logic/form";

interface Props {
  option: Option;
  raw: string | readonly string[] | undefined;
  error: string | undefined;
  onChange(raw: string | string[]): void;
}

export function OptionField(props: Props) {
  return props.option.type === "strings" ? <Checks {...props} /> : <Single {...props} />;
}

function Single({ option, raw, error, onChange }: Props) {
  const id = `option-${option.name}`;
  const text = typeof raw === "string" ? raw : "";
  const shared = {
    id,
    "aria-invalid": error !== undefined,
    "aria-describedby": `${id}-help ${id}-error`,
  };
  return (
    <div class="field">
      <label class="label" for={id}>
        {fieldName(option.name)}
        <span class="unit">{option.unit}</span>
      </label>
      {option.choices ? (
        <select {...shared} value={text} onChange={(event) => onChange(event.currentTarget.value)}>
          <option value="">{defaultText(option)} (default)</option>
          {option.choices
            .filter((choice) => choice !== option.default)
            .map((choice) => (
              <option key={choice} value={String(choice)}>
                {choice}
              </option>
            ))}
        </select>
      ) : (
        <input
          {...shared}
          value={text}
          type="text"
          inputMode={option.type === "string" ? undefined : "decimal"}
          autocomplete="off"
          spellcheck={false}
          placeholder={option.name === "label" ? "" : defaultText(option)}
          onInput={(event) => onChange(event.currentTarget.value)}
        />
      )}
      {option.name === "resolution" && <Resolutions option={option} text={text} onChange={onChange} />}
      <p id={`${id}-help`} class="help">
        {option.help} {option.type === "string" ? "" : rangeText(option)}
      </p>
      <p id={`${id}-error`} class="error" aria-live="polite">
        {error}
      </p>
    </div>
  );
}

const RESOLUTIONS = [128, 256, 512, 1024];

function Resolutions({ option, text, onChange }: Pick<Props, "option" | "onChange"> & { text: string }) {
  const now = Number(text || option.default);
  const fits = (one: number) => one >= (option.minimum ?? 0) && one <= (option.maximum ?? one);
  return (
    <div class="chips" role="group" aria-label="Common resolutions">
      {RESOLUTIONS.filter(fits).map((one) => (
        <button
          key={one}
          type="button"
          class="button"
          aria-pressed={now === one}
          onClick={() => onChange(one === option.default ? "" : String(one))}
        >
          {one}
        </button>
      ))}
    </div>
  );
}

function Checks({ option, raw, onChange }: Props) {
  const now = (typeof raw === "object" ? raw : option.default) as readonly string[];
  const toggle = (name: string, on: boolean) =>
    onChange((option.choices ?? []).map(String).filter((one) => (one === name ? on : now.includes(one))));
  return (
    <fieldset class="field plain">
      <legend class="label">{fieldName(option.name)}</legend>
      {(option.choices ?? []).map(String).map((name) => (
        <label key={name} class="check">
          <input
            type="checkbox"
            checked={now.includes(name)}
            onChange={(event) => toggle(name, event.currentTarget.checked)}
          />
          {name}
        </label>
      ))}
      <p class="help">{option.help}</p>
    </fieldset>
  );
}
