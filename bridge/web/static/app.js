// The frame of the page: what is shown, and the connection.
import { h, say } from "./dom.js";
import { configView } from "./config.js";
import { findView } from "./find.js";
import { happenedView, linesView } from "./lines.js";
import { ask, connect, link, listen } from "./link.js";
import { modulesView } from "./modules.js";
import { nextLanguage, t } from "./words.js";

const VIEWS = { modules: modulesView, lines: linesView, happened: happenedView, find: findView, config: configView };
const SWITCHING = new Set(["find", "config"]);
const THEMES = ["auto", "light", "dark"];
const $ = (id) => document.getElementById(id);
let view = null;
let frame = null; // disables all of it at once while what it shows may be old

const name = () => (location.hash.slice(1) in VIEWS ? location.hash.slice(1) : "modules");

function loginForm() {
  const told = h("p", { class: "verdict refused", role: "alert" });
  const key = h("input", { type: "password", id: "key", autocomplete: "current-password", required: true });
  const enter = async (event) => {
    event.preventDefault();
    const answer = await ask("POST", "api/login", { password: key.value });
    if (answer.code === 200) connect();
    else say(told, answer.error || t("no_answer"));
  };
  return h("form", { class: "login", onsubmit: enter }, h("label", { for: "key" }, t("password")), key,
    h("button", { type: "submit" }, t("login")), told);
}

function draw() {
  const chosen = name();
  $("tabs").replaceChildren(...Object.keys(VIEWS).filter((one) => link.maySwitch || !SWITCHING.has(one))
    .map((one) => h("a", { href: `#${one}`, "aria-current": one === chosen ? "page" : null }, t(one))));
  view = null;
  if (link.needsKey) {
    $("tabs").replaceChildren();
    $("main").replaceChildren(loginForm());
  } else if (link.state.house) {
    view = VIEWS[chosen]();
    frame = h("fieldset", { class: "frame", "aria-label": t(chosen) }, view.element);
    $("main").replaceChildren(frame);
  }
  drawLink();
}

function drawLink() {
  const { isFresh, needsKey } = link;
  document.body.classList.toggle("stale", !isFresh && !needsKey);
  if (frame) frame.disabled = !isFresh;
  const broker = link.state.bridge ? t(`broker_${link.state.bridge.broker}`) : "";
  const parts = isFresh ? [t("connected"), broker, link.maySwitch ? "" : t("only_look")] : [needsKey ? "" : t("lost")];
  say($("link"), parts.filter(Boolean).join(" · "));
  say($("language"), t("language"));
  $("language").lang = document.documentElement.lang === "en" ? "th" : "en";
  say($("theme"), t(`theme_${localStorage.getItem("theme") ?? "auto"}`));
  say($("logout"), t("logout"));
  $("logout").hidden = !(isFresh && link.hasSession);
}

function setTheme(theme) {
  localStorage.setItem("theme", theme);
  document.documentElement.dataset.theme = theme;
}

$("language").addEventListener("click", () => { nextLanguage(); draw(); });
$("theme").addEventListener("click", () => {
  setTheme(THEMES[(THEMES.indexOf(localStorage.getItem("theme") ?? "auto") + 1) % THEMES.length]);
  drawLink();
});
$("logout").addEventListener("click", async () => {
  await ask("POST", "api/logout", {});
  connect();
});
setTheme(localStorage.getItem("theme") ?? "auto");
addEventListener("hashchange", () => { draw(); $("main").focus(); });
setInterval(() => view?.tick?.(), 1000);

listen((what, key) => {
  if (what === "link") return link.needsKey ? draw() : drawLink();
  if (what === "hello" && link.needsKey) return draw();
  if (what === "state" && key === "house") return draw();
  if (what === "state" && key === "bridge") drawLink();
  view?.[what]?.(key);
});
drawLink();
connect();
