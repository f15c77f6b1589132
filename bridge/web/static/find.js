// Commissioning: choose a port, search it, see which module is which, name it all, save.
import { button, h, question, say } from "./dom.js";
import { ask, link } from "./link.js";
import { editor } from "./config.js";
import { dip } from "./modules.js";
import { t } from "./words.js";

const names = {}; // what was typed, by address: it outlives a change of the view

export function findView() {
  const scan = () => link.state.scan;
  const told = h("p", { class: "verdict refused", role: "alert" });
  const other = h("input", { id: "other", placeholder: "tcp://192.0.2.5:4196" });
  const otherRow = h("label", { for: "other" }, t("find_address"), other);
  const choice = h("select", { id: "port", onchange: () => { otherRow.hidden = choice.value !== ""; } });
  const thorough = h("input", { type: "checkbox", id: "thorough" });
  const start = button(t("find_start"), async () => {
    say(told, "");
    const answer = await ask("POST", "api/scan", { port: choice.value || other.value, thorough: thorough.checked });
    if (answer.error) say(told, answer.error);
  });
  const stop = button(t("find_stop"), () => ask("POST", "api/scan", { stop: true }), { class: "plain" });
  const bar = h("progress", { max: 1, "aria-label": t("find") });
  const step = h("p", { class: "since" });
  const count = h("p", { role: "status" });
  const modules = h("div", { class: "cards" });
  const text = editor(() => { location.hash = "#modules"; });
  const proposal = h("section", { hidden: true }, h("h2", {}, t("proposal")), text.element);
  const propose = button(t("propose"), async () => {
    proposal.hidden = false;
    text.show(await ask("POST", "api/proposal", { names }));
    proposal.scrollIntoView();
  });
  const cards = new Map();

  async function ports() {
    const { ports: found = [] } = await ask("GET", "api/ports");
    choice.replaceChildren(...found.map((one) => h("option", { value: one.port, disabled: Boolean(one.line) },
      one.line ? `${one.words} (${t("find_in_use", one.line)})` : one.words)), h("option", { value: "" }, t("find_other")));
    otherRow.hidden = choice.value !== "";
  }

  function field(address, key, text, of) {
    const own = (names[address] ??= { inputs: {}, outputs: {} });
    const bag = of ? own[of] : own;
    return h("label", {}, text, h("input", { value: bag[key] ?? null, maxlength: of || key === "name" ? 120 : 48,
      oninput: (event) => { bag[key] = event.target.value; } }));
  }

  function card(one) {
    const said = h("span", { class: "verdict", role: "status" });
    const which = h("select", { "aria-label": t("output") }, Array.from({ length: one.outputs }, (_, n) => h("option", {}, String(n + 1))));
    const blink = button(t("blink"), async () => {
      const output = Number(which.value);
      if (!(await question(t("blink"), h("p", {}, t("blink_note", output, one.address)), t("blink_yes"), t("cancel")))) return;
      say(said, t("sending"));
      const answer = await ask("POST", "api/blink", { address: one.address, output });
      said.className = `verdict ${answer.code === 200 ? "done" : "failed"}`;
      say(said, answer.code === 200 ? t("blinked") : answer.error || t("no_answer"));
    });
    const channels = (of, amount) => amount ? h("details", {}, h("summary", {}, t("names_of", t(of))),
      h("div", { class: "form" }, Array.from({ length: amount }, (_, n) => field(one.address, n + 1, `${t(of.slice(0, -1))} ${n + 1}`, of)))) : null;
    const title = `found-${one.address}`;
    return h("article", { class: "found module", "aria-labelledby": title },
      h("header", {}, h("h3", { id: title }, `${one.model}, ${t("address")} ${one.address}`), dip(one.dip),
        h("p", {}, `${one.protocol}, ${one.baud}`)),
      h("div", { class: "row" }, which, blink, said),
      h("div", { class: "form" }, field(one.address, "name", t("name")), field(one.address, "id", `${t("id")} (${t("id_note")})`),
        channels("inputs", one.inputs), channels("outputs", one.outputs)));
  }

  function draw() {
    const now = scan();
    const runs = Boolean(now?.running);
    start.disabled = runs;
    stop.hidden = bar.hidden = !runs;
    propose.hidden = runs || !now?.found.length;
    bar.value = now?.share ?? 0;
    say(step, runs && now.step ? t("find_progress", now.step.baud, now.step.protocol, now.step.address) : "");
    say(count, now ? [t("find_found", now.found.length), ...now.clashes.map((address) => t("find_clash", address)),
      now.error ?? "", !runs && !now.found.length && !now.error ? t("find_none") : ""].filter(Boolean).join(" ") : "");
    for (const one of now?.found ?? []) {
      const key = JSON.stringify(one);
      if (cards.get(one.address)?.key === key) continue;
      cards.set(one.address, { key, card: card(one) });
    }
    for (const address of [...cards.keys()]) if (!now?.found.some((one) => one.address === address)) cards.delete(address);
    const wanted = [...cards.entries()].sort(([a], [b]) => a - b).map(([, one]) => one.card);
    if (wanted.length !== modules.children.length || wanted.some((one, n) => modules.children[n] !== one)) modules.replaceChildren(...wanted);
  }

  ports();
  draw();
  return {
    element: h("div", {}, h("h2", {}, t("find")), h("p", {}, t("find_only_reads")),
      h("div", { class: "form" }, h("div", {}, h("label", { for: "port" }, t("find_port")), choice), otherRow,
        h("label", { class: "check", for: "thorough" }, thorough, t("find_thorough")),
        h("p", { class: "row" }, start, stop), told, bar, step, count),
      modules, h("p", {}, propose), proposal),
    state: (key) => key === "scan" && draw(),
  };
}
