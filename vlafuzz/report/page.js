"use strict";
const all = (selector, of = document) => [...of.querySelectorAll(selector)];
const cards = all(".card");
const form = document.querySelector(".filters");

// Filters: a card is shown when it fits every choice; every choice shows the number of cards that it would leave.
const values = (card, key) => card.dataset[key].split(" ");
const fits = (card, chosen) =>
  Object.entries(chosen).every(([key, value]) => !value || values(card, key).includes(value));

function narrow() {
  const selects = all("select", form);
  const chosen = Object.fromEntries(selects.map((select) => [select.name, select.value]));
  let shown = 0;
  for (const card of cards) {
    card.hidden = !fits(card, chosen);
    shown += !card.hidden;
  }
  for (const select of selects) {
    for (const option of select.options) {
      const count = cards.filter((card) => fits(card, { ...chosen, [select.name]: option.value })).length;
      option.textContent = `${option.value || "all"} (${count})`;
    }
  }
  form.querySelector("output").value = `${shown} of ${cards.length} shown`;
  form.querySelector("[type=reset]").disabled = !Object.values(chosen).some(Boolean);
  document.querySelector(".nothing").hidden = shown > 0;
}

if (form) {
  form.addEventListener("change", narrow);
  form.addEventListener("reset", () => setTimeout(narrow)); // after the browser has reset them
  form.addEventListener("submit", (event) => event.preventDefault());
  form.reset(); // browsers keep the choices when one navigates back
  narrow();
}

// Videos play while they are in sight, unless they are paused or the user prefers reduced motion.
const motion = document.querySelector(".motion");
const inSight = new Set();
let still = matchMedia("(prefers-reduced-motion: reduce)").matches;

function play(video) {
  if (inSight.has(video) && !still && !video.dataset.paused) video.play().catch(() => {});
  else video.pause();
}

const observer = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (isIntersecting) inSight.add(target);
    else inSight.delete(target);
    play(target);
  }
});

function show() {
  motion.textContent = still ? "Play videos" : "Pause videos";
  motion.setAttribute("aria-pressed", String(still));
  all("video").forEach(play);
}

for (const button of all(".film")) {
  const video = button.querySelector("video");
  observer.observe(video);
  button.addEventListener("click", () => {
    if (video.paused) {
      delete video.dataset.paused;
      video.play().catch(() => {});
    } else {
      video.dataset.paused = "yes";
      video.pause();
    }
  });
}

if (motion) {
  motion.addEventListener("click", () => {
    still = !still;
    all("video").forEach((video) => delete video.dataset.paused);
    show();
  });
  show();
}

// Commands can be copied.
for (const button of all(".copy")) {
  button.addEventListener("click", async () => {
    const code = button.parentElement.querySelector("code");
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "copied";
      setTimeout(() => (button.textContent = "copy"), 1500);
    } catch {
      getSelection().selectAllChildren(code);
    }
  });
}
