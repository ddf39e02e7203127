"use strict";
(async () => {
  const all = (what, within = document) => [...within.querySelectorAll(what)];
  const packed = Uint8Array.from(atob(document.getElementById("figures").textContent), (c) => c.charCodeAt(0));
  const figures = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
  // On paper the colours are those of the light page.
  const paper = { "--ink": "#1d2125", "--line": "#c9ced3" };
  let printing = false;
  const style = (name) => printing ? paper[name] : getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const config = { displaylogo: false, responsive: true, scrollZoom: false, modeBarButtonsToRemove: ["toImage"] };
  const drawn = new Set();

  // The page's colours, light or dark.
  function themed(layout) {
    const axes = { xaxis: {}, ...Object.fromEntries(Object.keys(layout).filter((key) => /^[xy]axis/.test(key)).map((key) => [key, layout[key]])) };
    for (const [key, axis] of Object.entries(axes)) axes[key] = { ...axis, gridcolor: style("--line"), zeroline: false };
    return { ...layout, ...axes, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest",
      font: { color: style("--ink"), family: "system-ui, sans-serif", size: 12 } };
  }
  // Nothing is drawn where it has no width: in what is folded.
  async function draw(home, size = {}) {
    if (!home.offsetWidth) return;
    const { data, layout } = figures[+home.dataset.figure];
    home.style.height = `${layout.height}px`;
    await Plotly.react(home, data, { ...themed(layout), ...size }, config);
    drawn.add(home);
  }
  // A film and the curves beside it have one time.
  function join(video) {
    const plot = video.parentElement.querySelector(".plot"), start = +video.dataset.start, speed = +video.dataset.speed;
    const cursor = figures[+plot.dataset.figure].layout.shapes.length - 1;
    const follow = () => {
      const time = start + speed * video.currentTime;
      if (drawn.has(plot)) Plotly.relayout(plot, { [`shapes[${cursor}].x0`]: time, [`shapes[${cursor}].x1`]: time });
      if (!video.paused && !video.ended) requestAnimationFrame(follow);
    };
    for (const event of ["play", "seeked", "timeupdate"]) video.addEventListener(event, () => (event === "play" || video.paused) && follow());
    plot.on("plotly_click", (event) => { video.pause(); video.currentTime = Math.max(0, (event.points[0].x - start) / speed); });
  }

  const verdict = document.getElementById("verdict");
  verdict?.addEventListener("change", () => {
    for (const claim of all(".claim")) claim.hidden = Boolean(verdict.value) && claim.dataset.verdict !== verdict.value;
    for (const system of all(".system")) system.open = Boolean(verdict.value);
  });
  all("details").forEach((each) => each.addEventListener("toggle", () => each.open && all(".plot", each).filter((home) => !drawn.has(home)).forEach((home) => draw(home))));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawn.forEach((home) => draw(home)));
  addEventListener("beforeprint", () => {
    printing = true;
    all("main details:not(.notices)").forEach((each) => { each.open = true; });
    all(".plot").forEach((home) => draw(home, { width: 680 }));
  });
  addEventListener("afterprint", () => {
    printing = false;
    drawn.forEach((home) => draw(home));
  });
  for (const home of all(".plot")) await draw(home);
  all("video").forEach(join);
  document.documentElement.dataset.ready = "yes";
})();
