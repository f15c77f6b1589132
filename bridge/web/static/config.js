// The text of the configuration, with its problems beside the lines.
import { button, h, say } from "./dom.js";
import { ask, link } from "./link.js";
import { t } from "./words.js";

const CHECK_AFTER_MS = 600;

export function editor(onsaved) {
  let file = { text: "", version: "", file: "" };
  let timer = null;
  const gutter = h("pre", { class: "gutter text", "aria-hidden": "true" });
  const area = h("textarea", { class: "text", spellcheck: "false", wrap: "off", autocapitalize: "off", "aria-describedby": "told" });
  const told = h("p", { id: "told", class: "verdict", role: "status" });
  const wrongs = h("ul", { class: "wrongs" });
  const label = h("label", { for: "text" });
  area.id = "text";

  function draw(problems = []) {
    const wrong = new Set(problems.map((one) => one.line));
    const count = area.value.split("\n").length;
    gutter.replaceChildren(...Array.from({ length: count }, (_, n) =>
      h("span", { class: wrong.has(n + 1) ? "wrong" : null }, `${wrong.has(n + 1) ? "▶ " : ""}${n + 1}\n`)));
    area.rows = count + 1;
    area.style.height = "auto";
    area.style.width = `${Math.max(...area.value.split("\n").map((line) => line.length)) + 4}ch`;
    wrongs.replaceChildren(...problems.map((one) => h("li", {}, button(t("at_line", one.line, one.column, one.message), () => jump(one), { class: "plain" }))));
  }

  function jump({ line, column }) {
    const at = area.value.split("\n").slice(0, line - 1).reduce((sum, text) => sum + text.length + 1, 0) + column - 1;
    area.focus();
    area.setSelectionRange(at, at);
  }

  function judged(answer) {
    draw(answer.problems ?? []);
    const found = (answer.problems ?? []).length;
    told.className = `verdict ${found || answer.error ? "refused" : "done"}`;
    say(told, found ? t("problems", found) : answer.error || [t("valid"), ...(answer.warnings ?? [])].join("; "));
  }

  const check = async () => judged(await ask("POST", "api/check", { text: area.value }));
  area.addEventListener("input", () => {
    draw();
    clearTimeout(timer);
    timer = setTimeout(check, CHECK_AFTER_MS);
  });

  async function save() {
    const answer = await ask("PUT", "api/config", { text: area.value, version: file.version });
    if (answer.code !== 200) return judged(answer);
    file.version = answer.version;
    told.className = "verdict done";
    say(told, t("saved", answer.copy));
    onsaved?.();
  }

  function show(shown) {
    if (shown.error) return judged(shown);
    file = shown;
    say(label, t("text_of", shown.file));
    area.value = shown.text;
    return check();
  }
  const read = async () => show(await ask("GET", "api/config"));

  return {
    show, read,
    element: h("div", {}, label, h("div", { class: "editor" }, gutter, area), wrongs, told,
      h("p", { class: "row" }, button(t("save"), save), button(t("check"), check, { class: "plain" }),
        button(t("reload_file"), read, { class: "plain" }))),
  };
}

// A backup of the cabinet: made by the bridge between its polls, then fetched.
function backup() {
  const told = h("p", { class: "verdict", role: "status" });
  const bar = h("progress", { max: 1, "aria-label": t("backup") });
  const fetched = h("a", { href: "api/backup", download: "" }, t("backup_fetch"));
  const make = button(t("backup_make"), async () => {
    const { error } = await ask("POST", "api/backup", {});
    if (error) say(told, error);
  });
  function draw() {
    const now = link.state.backup;
    make.disabled = Boolean(now?.running);
    bar.hidden = !now?.running;
    bar.value = now?.share ?? 0;
    fetched.hidden = !now?.ready;
    say(told, now ? [now.error, ...(now.left_out.length ? [t("backup_without"), ...now.left_out] : [])].filter(Boolean).join("; ") : "");
  }
  draw();
  return { draw, element: h("section", {}, h("h2", {}, t("backup")), h("p", {}, t("backup_note")),
    h("p", { class: "row" }, make, fetched), bar, told) };
}

export function configView() {
  const made = editor();
  const kept = backup();
  made.read();
  return {
    element: h("div", {}, h("section", {}, h("h2", {}, t("config")), made.element), kept.element),
    state: (key) => key === "backup" && kept.draw(),
  };
}
