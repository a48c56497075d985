const box = document.getElementById("search");
const cards = [...document.querySelectorAll("article")];
const count = document.getElementById("count");
function search() {
  const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const card of cards) {
    const fits = words.every((word) => card.dataset.words.includes(word));
    card.hidden = !fits;
    shown += fits;
  }
  count.textContent = `${shown} of ${cards.length} templates`;
}
box.addEventListener("input", search);
box.value = decodeURIComponent(location.hash.slice(1));
search();
