// What the page does beyond forms and links: logs that are dropped, news from the server, and parts that are made anew.
"use strict";

const root = document.body.dataset.root;
const told = document.getElementById("told");
document.documentElement.classList.add("scripted");

function say(text, seconds = 6) {
  told.textContent = text;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => { told.textContent = ""; }, 1000 * seconds);
}

// ---- logs that are dropped

const drop = document.getElementById("drop");
if (drop) {
  const input = document.getElementById("files");
  input.addEventListener("change", () => { sendAll(input.files); input.value = ""; });
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, (event) => {
      if (!event.dataTransfer || ![...event.dataTransfer.types].includes("Files")) return;
      event.preventDefault();
      drop.classList.toggle("over", name === "dragover");
      if (name === "drop") sendAll(event.dataTransfer.files);
    });
  }
}

let underway = 0; // logs that are not here yet

async function sendAll(files) {
  underway += files.length;
  for (const file of [...files]) {
    await send(file);
    underway -= 1;
  }
}

window.addEventListener("beforeunload", (event) => { if (underway) event.preventDefault(); });

function send(file) {
  const row = document.createElement("li");
  const bar = document.createElement("progress");
  bar.max = 1;
  bar.value = 0;
  bar.setAttribute("aria-label", `how much of ${file.name} has come`);
  row.append(`${file.name} `, bar);
  document.getElementById("sending").append(row);
  return new Promise((resolve) => {
    const request = new XMLHttpRequest();
    request.open("POST", `${root}logs?name=${encodeURIComponent(file.name)}`);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.setRequestHeader("Accept", "application/json");
    request.upload.addEventListener("progress", (event) => { bar.value = event.loaded / event.total; });
    request.addEventListener("loadend", () => {
      if (request.status === 201) {
        row.remove();
        say(`${file.name} is here`);
      } else {
        let why = request.responseText || "the server is not there";
        try { why = JSON.parse(why).detail; } catch { /* it is plain text */ }
        row.textContent = `${file.name}: ${why}`;
      }
      renew();
      resolve();
    });
    request.send(file);
  });
}

// ---- parts that are made anew when something has changed

async function renew(changed = null) {
  if (!document.querySelector("[data-live]")) return;
  const asked = renew.asked = (renew.asked || 0) + 1;
  let text;
  try {
    const answer = await fetch(location.href, { headers: { Accept: "text/html" } });
    if (!answer.ok) return;
    text = await answer.text();
  } catch {
    return; // the server is away; when it is back, its first event renews
  }
  if (asked !== renew.asked) return; // a newer answer is on its way
  const live = document.querySelectorAll("[data-live]");
  const fresh = new DOMParser().parseFromString(text, "text/html");
  for (const part of live) {
    const now = fresh.getElementById(part.id);
    if (!now || now.innerHTML === part.dataset.shown) continue;
    const shown = now.innerHTML;
    const focus = part.contains(document.activeElement) ? document.activeElement.id : "";
    const ticked = [...part.querySelectorAll("input[type=checkbox]:checked")].map((box) => box.id);
    const active = document.activeElement;
    if (active instanceof HTMLSelectElement && active.form !== changed && part.contains(active)) continue; // somebody chooses
    part.replaceChildren(...now.childNodes);
    part.dataset.shown = shown;
    for (const id of ticked) if (id && document.getElementById(id)) document.getElementById(id).checked = true;
    if (focus && document.getElementById(focus)) document.getElementById(focus).focus();
    prepare(part);
  }
}

// What is set of a dive is set without leaving the page, which would break off the logs that are sent from it.
async function set(form) {
  const headers = { Accept: "application/json" };
  try {
    const answer = await fetch(form.action, { method: "POST", headers, body: new URLSearchParams(new FormData(form)) });
    if (!answer.ok) say((await answer.json()).detail);
  } catch {
    say("the server is not there");
  }
  renew(form);
}

function prepare(part) {
  for (const form of part.querySelectorAll("form[data-stay]")) {
    form.addEventListener("submit", (event) => { event.preventDefault(); set(form); });
  }
  for (const form of part.querySelectorAll("form[data-submit]")) {
    form.addEventListener("change", () => form.requestSubmit());
  }
  for (const form of part.querySelectorAll("form[data-confirm]")) {
    form.addEventListener("submit", (event) => { if (!confirm(form.dataset.confirm)) event.preventDefault(); });
  }
  for (const frame of part.querySelectorAll("iframe.report")) fit(frame);
  for (const place of part.querySelectorAll("[data-overview]")) showOverview(place);
}

// The report runs no script; this page, which is of the same origin, gives its frame the height of what is in it.
function fit(frame) {
  const measure = () => {
    const inside = frame.contentDocument;
    if (inside && inside.body) frame.style.height = `${inside.documentElement.offsetHeight + 4}px`;
  };
  frame.addEventListener("load", () => {
    measure();
    if (frame.contentDocument && frame.contentDocument.body) {
      new ResizeObserver(measure).observe(frame.contentDocument.body);
    }
  });
}

// ---- news from the server; a browser has few connections to one server, so only a page that is seen holds one

let news = null;

function listen() {
  if (document.hidden || news || !document.querySelector("[data-live]")) return;
  news = new EventSource(`${root}events`);
  news.addEventListener("hello", () => renew());
  news.addEventListener("changed", () => renew());
  news.addEventListener("progress", (event) => {
    for (const job of JSON.parse(event.data)) {
      for (const place of document.querySelectorAll(`[data-job="${job.id}"]`)) {
        const bar = place.querySelector("progress");
        if (!bar) continue;
        bar.value = job.share;
        place.querySelector(".stage").textContent = `${Math.round(100 * job.share)} % ${job.stage}`;
      }
    }
  });
}

function rest() {
  if (news) news.close();
  news = null;
}

document.addEventListener("visibilitychange", () => (document.hidden ? rest() : listen()));
window.addEventListener("pagehide", rest);
window.addEventListener("pageshow", listen);
for (const part of document.querySelectorAll("[data-live]")) part.dataset.shown = part.innerHTML;
prepare(document);
