const box = document.getElementById("search");
const cards = [...document.querySelectorAll("li[data-words]")];
const count = document.getElementById("count");
function search() {
  const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
  const fits = new Set();
  for (const card of cards) {
    if (!words.every((word) => card.dataset.words.includes(word))) continue;
    // a folded step shows with the step that it is folded into
    for (let at = card; at; at = at.parentElement.closest("li[data-words]")) fits.add(at);
  }
  for (const card of cards) {
    card.hidden = !fits.has(card);
    const folded = card.parentElement.closest("li[data-words] > details");
    if (folded && words.length) folded.open = [...folded.querySelectorAll("li")].some((one) => fits.has(one));
  }
  for (const part of document.querySelectorAll("section")) part.hidden = !part.querySelector("li:not([hidden])");
  count.textContent = `${fits.size} of ${cards.length} steps`;
}
function reveal() {
  const step = document.getElementById(location.hash.slice(1));
  if (!step) return;
  for (let at = step.closest("details"); at; at = at.parentElement.closest("details")) at.open = true;
  step.scrollIntoView({ block: "center" });
}
box.addEventListener("input", search);
addEventListener("hashchange", reveal);
search();
reveal();
