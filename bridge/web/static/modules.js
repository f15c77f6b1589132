// The modules as they are: terminals with LEDs, names, switches, outputs to press.
import { button, h, question, say } from "./dom.js";
import { bridgeNow, command, link } from "./link.js";
import { t, why } from "./words.js";

const VERDICT_MS = 20000;

export function ago(at) {
  const s = Math.max(0, Math.round(bridgeNow() - at));
  if (s < 60) return t("ago_s", s);
  return s < 3600 ? t("ago_min", Math.floor(s / 60)) : t("ago_h", Math.floor(s / 3600));
}

export function verdictText(verdict) {
  if (verdict.status === "stale") return t("not_sent");
  if (verdict.status === "error") return verdict.detail || t("no_answer");
  const more = verdict.reason ? `: ${why(verdict.reason)}` : verdict.ms == null ? "" : `, ${verdict.ms} ms`;
  return t(verdict.status) + more + (verdict.detail ? ` (${verdict.detail})` : "");
}

// Sends, and shows the verdict where it was pressed.
async function send(pressed, told, station, target, payload) {
  pressed.setAttribute("aria-busy", "true");
  told.className = "verdict";
  say(told, t("sending"));
  const verdict = await command(station, target, payload);
  pressed.removeAttribute("aria-busy");
  told.className = `verdict ${verdict.status}`;
  say(told, verdictText(verdict));
  clearTimeout(told.timer);
  told.timer = setTimeout(() => say(told, ""), VERDICT_MS);
}

export function dip(switches) {
  const told = switches.map((on) => (on ? "1" : "0")).join("");
  return h("svg", { class: "dip", viewBox: "0 0 98 30", role: "img", "aria-label": `${t("dip")} ${told}` },
    h("rect", { class: "case", width: 98, height: 30, rx: 3 }),
    switches.map((on, n) => [
      h("rect", { class: "slot", x: 5 + n * 11.3, y: 4, width: 8, height: 15, rx: 1 }),
      h("rect", { class: "knob", x: 6 + n * 11.3, y: on ? 5 : 12, width: 6, height: 6 }),
      h("text", { x: 9 + n * 11.3, y: 27 }, String(n + 1)),
    ]));
}

const told = () => h("span", { class: "verdict", role: "status" });

// One row. A place is kept free for the last change: so nothing moves when there is one.
function terminal(channel, note, actions) {
  const led = h("span", { class: "led", "aria-hidden": "true" });
  const word = h("span", { class: "word" });
  const since = h("span", { class: "since" });
  const row = h("li", { class: actions ? null : "flat" }, led, h("span", { class: "number" }, String(channel.n)),
    h("span", { class: "name" }, channel.name ?? ""), since, word, note, actions);
  return { row, update(values) {
    const on = values?.on.includes(channel.n);
    row.classList.toggle("on", Boolean(on));
    say(word, values ? (on ? "ON" : "OFF") : "–");
    const at = values?.at[channel.n];
    say(since, at == null ? "" : ago(at));
  } };
}

function input(channel) {
  const count = h("span", { class: "note" });
  const made = terminal(channel, count);
  return { row: made.row, update(state) {
    made.update(state?.di);
    const edges = state?.counts[channel.n];
    say(count, edges == null ? "" : t("counted", edges));
  } };
}

function output(station, channel) {
  const told_ = told();
  const press = h("button", { type: "button", class: "press" });
  const set = button("⋯", () => settings(station, channel, current, set, told_), {
    class: "plain", "aria-label": `${t("settings")}: ${name(station, channel)}` });
  const locked = channel.read_only ? t("read_only") : channel.cover ? t("of_a_cover") : null;
  const able = !locked && link.maySwitch;
  const made = terminal(channel, locked ? h("span", { class: "note" }, locked) : null,
    able ? h("span", { class: "actions" }, press, set) : null);
  made.row.append(told_);
  let current = null;
  const isPulse = () => (current?.settings ? current.settings.pulse.includes(channel.n) : channel.mode === "pulse");
  press.addEventListener("click", () => {
    const on = current?.do?.on.includes(channel.n);
    send(press, told_, station.id, `do/${channel.n}`, isPulse() ? "PRESS" : on ? "OFF" : "ON");
  });
  return { row: made.row, update(state, usable) {
    current = state;
    made.update(state?.do);
    const hold = state?.settings?.hold[channel.n - 1] ?? channel.hold;
    const on = state?.do?.on.includes(channel.n);
    say(press, isPulse() ? `${t("press")}${hold ? ` ${hold} s` : ""}` : t(on ? "switch_off" : "switch_on"));
    press.setAttribute("aria-label", `${press.textContent}: ${name(station, channel)}`);
    press.disabled = !usable;
    set.disabled = !usable || !state?.settings;
  } };
}

const name = (station, channel) => `${station.name}, ${channel.name ?? `${t("output")} ${channel.n}`}`;

async function settings(station, channel, state, pressed, told_) {
  const is = state.settings.pulse.includes(channel.n) ? "pulse" : "latch";
  const mode = h("select", { id: "mode" }, ["latch", "pulse"].map((word) =>
    h("option", { value: word, selected: word === is }, t(word))));
  const was = state.settings.hold[channel.n - 1];
  const hold = h("input", { id: "hold", type: "number", min: "0.1", max: "25.5", step: "0.1", value: was });
  const body = h("div", {}, h("p", {}, t("settings_note")),
    h("label", { for: "mode" }, t("mode")), mode, h("label", { for: "hold" }, t("hold")), hold);
  if (!(await question(`${t("settings")}: ${name(station, channel)}`, body, t("save"), t("cancel")))) return;
  if (mode.value !== is) await send(pressed, told_, station.id, `do/${channel.n}/mode`, mode.value);
  if (Number(hold.value) !== was) await send(pressed, told_, station.id, `do/${channel.n}/hold`, Number(hold.value));
}

function cover(station, one) {
  const told_ = told();
  const state = h("span", { class: "word" });
  const slider = h("input", { type: "range", min: "0", max: "100", "aria-label": `${t("position")}: ${one.name}` });
  slider.addEventListener("change", () =>
    send(slider, told_, station.id, `cover/${one.id}/position`, Number(slider.value)));
  const ways = ["OPEN", "STOP", "CLOSE"].map((word) => {
    const made = button(t(word.toLowerCase()), () => send(made, told_, station.id, `cover/${one.id}`, word),
      { class: "press", "aria-label": `${t(word.toLowerCase())}: ${one.name}` });
    return made;
  });
  const row = h("li", { class: "cover" }, h("span", { class: "name" }, one.name), state,
    link.maySwitch ? [h("span", { class: "row" }, ways), slider] : null, told_);
  return { row, update(all, usable) {
    const now = all?.covers[one.id];
    say(state, now ? `${t(now.state === "open" ? "is_open" : now.state)}${now.position == null ? "" : ` ${now.position} %`}` : "–");
    if (now?.position != null && document.activeElement !== slider) slider.value = now.position;
    for (const control of [...ways, slider]) control.disabled = !usable;
  } };
}

function list(title, rows, kind = "") {
  return rows.length ? h("div", {}, h("h4", {}, title), h("ul", { class: `terminals ${kind}` }, rows.map((one) => one.row))) : null;
}

function card(line, station) {
  const ins = station.inputs.map(input);
  const outs = station.outputs.map((one) => output(station, one));
  const covers = station.covers.map((one) => cover(station, one));
  const state = h("span", { class: "state" });
  const trouble = h("p", { class: "trouble", role: "status" });
  const title = `station-${station.id}`;
  const article = h("article", { class: "module", "aria-labelledby": title },
    h("header", {}, h("h3", { id: title }, station.name), state,
      h("p", {}, `${station.model}, ${t("address")} ${station.address}`, station.area ? `, ${station.area}` : ""),
      dip(station.dip)),
    trouble, h("div", { class: "body" }, list(t("inputs"), ins, "in"), list(t("outputs"), outs), list(t("covers"), covers)));
  return { article, update() {
    const now = link.state[`station/${station.id}`];
    const lineUp = link.state[`line/${line.id}`]?.online;
    const up = Boolean(now?.online && lineUp);
    article.classList.toggle("offline", !up);
    say(state, up ? t("online") : lineUp ? t("offline") : t("line_offline"));
    const problem = now?.problem ? `${why(now.problem.reason)}: ${now.problem.detail}` : "";
    say(trouble, problem || (up ? "" : (lineUp ? now?.detail : link.state[`line/${line.id}`]?.detail) || ""));
    for (const one of ins) one.update(now);
    for (const one of [...outs, ...covers]) one.update(now, up);
  } };
}

export function modulesView() {
  const cards = new Map();
  const parts = (link.state.house?.lines ?? []).map((line) => {
    const made = line.stations.map((station) => card(line, station));
    line.stations.forEach((station, n) => cards.set(station.id, made[n]));
    return h("section", {}, h("h2", {}, line.id, " ", h("small", {}, `${line.port}, ${line.baud}, ${line.protocol}`)),
      h("div", { class: "cards" }, made.map((one) => one.article)));
  });
  const update = () => cards.forEach((one) => one.update());
  update();
  const none = link.state.house && !cards.size;
  return {
    element: h("div", {}, none ? h("p", {}, t("no_modules"), " ", h("a", { href: "#find" }, t("find"))) : parts),
    state: (key) => (key.startsWith("station/") ? cards.get(key.slice(8))?.update() : key.startsWith("line/") && update()),
    tick: update,
  };
}
