// How the lines are doing, what passes on them, and what happened.
import { button, h, say } from "./dom.js";
import { ask, bridgeNow, dateOf, link } from "./link.js";
import { t, why } from "./words.js";
import { verdictText } from "./modules.js";

const spread = (ms) => (ms?.p50 == null ? "–" : `${ms.p50} / ${ms.p99} ms`);
const clock = (at) => dateOf(at).toLocaleTimeString([], { hour12: false });

function curve(hour) {
  const points = hour.filter((one) => one.cycle != null);
  if (points.length < 2) return h("p", { class: "since" }, t("not_measured"));
  const most = Math.max(...points.map((one) => one.cycle));
  const x = (at) => (300 - ((bridgeNow() - at) / 3600) * 300).toFixed(1);
  const told = `${t("hour")}: ${Math.min(...points.map((one) => one.cycle))}–${most} ms`;
  return h("figure", {},
    h("svg", { class: "curve", viewBox: "0 0 300 60", role: "img", "aria-label": told },
      h("polyline", { points: points.map((one) => `${x(one.at)},${(58 - (one.cycle / most) * 54).toFixed(1)}`).join(" ") })),
    h("figcaption", {}, told));
}

const cells = (kind, texts) => texts.map((text) => h(kind, kind === "th" ? { scope: "col" } : {}, text));

function lineCard(line) {
  const state = link.state[`line/${line.id}`];
  const figures = state?.diagnostics;
  const counters = (one) => one ? `${one.good} ${t("good")}, ${one.silent} ${t("silent")}, ${one.bad} ${t("bad")}, ${one.refused} ${t("refused")}` : "–";
  const rows = line.stations.map((station) => {
    const own = link.state[`station/${station.id}`];
    const told = own?.diagnostics;
    return h("tr", {}, h("th", { scope: "row" }, station.name), cells("td", [
      t(own?.online ? "online" : "offline"), told ? `${told.bound_ms} ms` : "–", told?.age_ms == null ? "–" : `${told.age_ms} ms`,
      counters(told?.counters), told?.last_error ?? ""]));
  });
  return h("section", { class: "line" }, h("h2", {}, line.id),
    h("p", {}, `${line.port}, ${line.baud}, ${line.protocol}: `, h("strong", {}, t(state?.online ? "online" : "offline")), " ", state?.detail ?? ""),
    h("p", {}, `${t("cycle")} ${spread(figures?.cycle_ms)} · ${t("utilisation")} ${figures ? `${Math.round(figures.utilisation * 100)} %` : "–"} · ${counters(figures?.counters)}`),
    curve(state?.hour ?? []),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": line.id }, h("table", {},
      h("thead", {}, h("tr", {}, cells("th", [t("module"), t("state"), t("bound"), t("age"), t("errors"), t("last_error")]))),
      h("tbody", {}, rows))));
}

function tracePart(line) {
  const told = h("span", { class: "verdict", role: "status" });
  const set = (span) => async () => {
    const answer = await ask("POST", "api/trace", { line: line.id, for_s: span });
    say(told, answer.error ?? "");
  };
  return h("p", { class: "row" }, button(`${t("trace_start")}: ${line.id}`, set(60)),
    button(`${t("trace_stop")}: ${line.id}`, set(0), { class: "plain" }), told);
}

function traceLine(one) {
  const way = { request: "→", reply: "←" }[one.direction] ?? "?";
  const ms = one.reply_ms == null ? "" : ` (${one.reply_ms} ms)`;
  return `${clock(one.at)} ${one.line} ${way} ${one.station ?? ""} ${one.meaning ?? ""}${ms}`
    + `${one.problem ? ` ! ${one.problem}` : ""}   ${one.bytes}${one.dropped ? `  +${one.dropped}` : ""}`;
}

export function linesView() {
  const lines = link.state.house?.lines ?? [];
  const cards = h("div", {});
  const trace = h("pre", { class: "trace", tabindex: "0", role: "region", "aria-label": t("trace_lines") });
  const draw = () => cards.replaceChildren(...lines.map(lineCard));
  const traced = () => say(trace, link.trace.slice(-200).map(traceLine).join("\n"));
  draw();
  traced();
  return {
    element: h("div", {}, cards, lines.length ? h("section", {}, h("h2", {}, t("trace")),
      link.maySwitch ? lines.map(tracePart) : null, trace) : h("p", {}, t("no_modules"))),
    state: (key) => (key.startsWith("line/") || key.startsWith("station/")) && (cards.dirty = true),
    tick: () => { if (cards.dirty) { cards.dirty = false; draw(); } },
    trace: () => { trace.timer ??= setTimeout(() => { trace.timer = null; traced(); }, 500); },
  };
}

const KINDS = { value: "value", gesture: "value", verdict: "verdict", problem: "problem", station: "problem", line: "problem", rule: "verdict", log: "log" };

function told(one) {
  if (one.kind === "verdict") {
    const by = one.by === "panel" ? ` ${t("by_panel")}` : one.by ? ` (${one.by})` : "";
    return `${JSON.stringify(one.payload)}${by}: ${verdictText(one)}`;
  }
  if (one.kind === "problem") return one.reason ? `${why(one.reason)}: ${one.detail}` : t("problem_gone");
  if (one.kind === "log") return `${one.level}: ${one.message}`;
  if (one.kind === "gesture") return t(one.state);
  if (one.kind === "rule" && one.state === "held") return `${t("rule_held")}: ${one.detail}`;
  if (one.kind === "rule") return one.state === "fired" ? t("rule_fired") : one.state;
  if (one.kind === "value") return one.state;
  return `${t(one.state)} ${one.detail ?? ""}`;
}

// Where it was, by the names of module and channel.
function placeOf(one) {
  const stations = (link.state.house?.lines ?? []).flatMap((line) => line.stations);
  const station = stations.find((found) => found.id === one.where);
  const [way, number] = (one.target ?? "").split("/");
  const channel = { di: station?.inputs, do: station?.outputs }[way]?.find((found) => String(found.n) === number);
  return [station?.name ?? one.where, channel?.name, one.target].filter(Boolean).join(", ");
}

export function happenedView() {
  const shown = new Set(["value", "verdict", "problem", "log"]);
  const list = h("ol", { class: "happened" });
  const search = h("input", { type: "search", id: "search", oninput: () => draw() });
  const kinds = [...shown].map((kind) => h("label", {}, h("input", { type: "checkbox", checked: true, onchange: (event) => {
    if (event.target.checked) shown.add(kind); else shown.delete(kind);
    draw();
  } }), t(`kind_${kind}`)));
  function draw() {
    const wanted = search.value.toLowerCase();
    const found = link.happened.map((one) => [one, `${placeOf(one)} ${told(one)}`])
      .filter(([one, text]) => shown.has(KINDS[one.kind]) && text.toLowerCase().includes(wanted)).slice(-200).reverse();
    list.replaceChildren(...found.map(([one, text]) =>
      h("li", { class: `is-${one.kind} ${one.status ?? one.level ?? ""}` }, h("time", {}, clock(one.at)), " ", text)));
    if (!found.length) list.append(h("li", {}, t("nothing")));
  }
  let dirty = false;
  draw();
  return {
    element: h("div", {}, h("fieldset", { class: "row" }, h("legend", {}, t("show")), kinds,
      h("label", { for: "search" }, t("search")), search), list),
    happened: () => { dirty = true; },
    tick: () => { if (dirty) { dirty = false; draw(); } },
  };
}
