// The connection to the bridge: what it told, how old that is, and what is asked of it.
const QUIET_S = 12; // beats come each 5 s
const RETRY_MS = 1500;

export const link = {
  state: {}, happened: [], trace: [], run: null, maySwitch: false, hasSession: false, isFresh: false, needsKey: false,
};
const listeners = new Set();
let source = null;
let told = null; // the newest instant of the bridge, and ours at that moment

export const listen = (listener) => listeners.add(listener);
const tell = (what, key) => listeners.forEach((listener) => listener(what, key));

// The instant on the clock of the bridge. performance.now() may stand still while a telephone
// sleeps: then this is too old, and a press is refused as late, which is the safe side.
export const bridgeNow = () => (told ? told.now + (performance.now() - told.at) / 1000 : 0);
export const dateOf = (at) => new Date(Date.now() - (bridgeNow() - at) * 1000);

const age = () => (told ? Math.max(performance.now() - told.at, Date.now() - told.date) / 1000 : Infinity);

function heard(now) {
  told = { now, at: performance.now(), date: Date.now() };
  if (!link.isFresh) {
    link.isFresh = true;
    tell("link");
  }
}

function lost() {
  source?.close();
  source = null;
  if (link.isFresh) {
    link.isFresh = false;
    tell("link");
  }
}

export function connect() {
  lost();
  const opened = (source = new EventSource("api/events"));
  const on = (name, act) => opened.addEventListener(name, (event) => opened === source && act(JSON.parse(event.data)));
  on("hello", (hello) => {
    if (hello.run !== link.run) Object.assign(link, { happened: [], trace: [] });
    Object.assign(link, { run: hello.run, maySwitch: hello.may_switch, hasSession: hello.has_session, needsKey: false, state: {}, happened: [] });
    heard(hello.now);
    tell("hello");
  });
  on("beat", (beat) => heard(beat.now));
  on("state", ({ key, value }) => {
    link.state[key] = value;
    tell("state", key);
  });
  for (const list of ["happened", "trace"]) {
    on(list, (entry) => {
      link[list].push(entry);
      if (link[list].length > 500) link[list].shift();
      tell(list);
    });
  }
  opened.onerror = async () => {
    if (opened !== source) return;
    lost();
    try {
      link.needsKey = (await fetch("api/state")).status === 401;
    } catch { /* it is not there at all */ }
    if (link.needsKey) tell("link");
    else setTimeout(() => source ?? connect(), RETRY_MS);
  };
}

// A telephone that wakes up must not show, nor press, what was true before it slept.
function look() {
  if (link.isFresh && age() > QUIET_S) connect();
}
setInterval(look, 1000);
document.addEventListener("visibilitychange", look);
addEventListener("pageshow", look);
addEventListener("online", () => !link.isFresh && !link.needsKey && connect());

export async function ask(method, path, body) {
  try {
    const answer = await fetch(path, {
      method, headers: body ? { "Content-Type": "application/json" } : {},
      body: body && JSON.stringify(body),
    });
    if (answer.status === 401 && path !== "api/login") {
      link.needsKey = true;
      lost();
      tell("link");
    }
    return { code: answer.status, ...(await answer.json()) };
  } catch {
    return { code: 0, error: "" };
  }
}

// A command carries the instant of its press: one that is held up on its way switches nothing.
export async function command(station, target, payload) {
  look();
  if (!link.isFresh) return { status: "stale" };
  const at = bridgeNow();
  const answer = await ask("POST", "api/command", { station, target, payload, at, run: link.run });
  return answer.status ? answer : { status: "error", detail: answer.error };
}
