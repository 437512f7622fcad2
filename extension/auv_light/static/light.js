"use strict";
// Paths are relative: BlueOS serves this page below one of its own. Text of logs is only ever text, never markup.
const EVERY_MS = 3000;
const place = (name) => document.getElementById(name);

function row(...cells) {
  const made = document.createElement("tr");
  for (const cell of cells) {
    const td = document.createElement("td");
    td.append(cell);
    made.append(td);
  }
  return made;
}

function mark(dive) {
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = dive.sound;
  box.setAttribute("aria-label", `${dive.name} was sound`);
  box.addEventListener("change", async () => {
    const asked = `dives/${dive.id}/sound?sound=${box.checked}`;
    await fetch(asked, { method: "POST", headers: { "x-auv-light": "1" } });
    show();
  });
  return box;
}

function report(dive) {
  if (!dive.light) return dive.summary;
  const link = document.createElement("a");
  link.href = `dives/${dive.id}/report`;
  link.textContent = dive.summary;
  return link;
}

async function show() {
  const told = await (await fetch("status")).json();
  place("light").dataset.light = told.newest.light || "";
  place("word").textContent = told.newest.light || (told.newest.summary ? "no verdict" : told.doing);
  place("summary").textContent = told.newest.name ? `${told.newest.name}: ${told.newest.summary || told.doing}` : "";
  if (!place("dives")) return;
  place("doing").textContent = told.doing;
  place("thrusters").replaceChildren(...told.thrusters.map((one, n) =>
    row(String(n + 1), one.hours.toFixed(1), one.full_hours.toFixed(2), String(one.starts))));
  place("dives").replaceChildren(...told.dives.map((dive) => row(dive.name, dive.light || "–", mark(dive), report(dive))));
}

show();
setInterval(show, EVERY_MS);
