// A slider over pictures, or over marks that move on a figure, with a button that plays them.
for (const player of document.querySelectorAll(".player")) {
  const range = player.querySelector(".controls input");
  if (!range) continue;
  const button = player.querySelector(".controls button"), output = player.querySelector("output");
  const stills = [...player.querySelectorAll(".still")], film = player.querySelector("script");
  const { names, marks } = film ? JSON.parse(film.textContent) : { names: stills.map((s) => s.dataset.name), marks: [] };
  const dots = [...player.querySelectorAll(".now")];
  let timer = 0;
  const show = () => {
    const at = +range.value;
    stills.forEach((still, k) => { still.hidden = k !== at; });
    dots.forEach((dot, k) => {
      dot.style.left = `${100 * marks[k][at][0]}%`;
      if (dot.classList.contains("dot")) dot.style.top = `${100 * marks[k][at][1]}%`;
    });
    output.textContent = names[at];
  };
  const stop = () => { clearInterval(timer); timer = 0; button.textContent = "▶"; button.ariaLabel = "play"; };
  const step = () => {
    if (+range.value === +range.max) return stop();
    range.value = +range.value + 1;
    show();
  };
  button.addEventListener("click", () => {
    if (timer) return stop();
    if (+range.value === +range.max) { range.value = 0; show(); }
    timer = setInterval(step, Math.max(40, Math.min(400, 8000 / names.length)));
    button.textContent = "⏸";
    button.ariaLabel = "pause";
  });
  range.addEventListener("input", () => { stop(); show(); });
  show();
}
