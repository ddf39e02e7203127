"use strict";
(async () => {
  const all = (what, within = document) => [...within.querySelectorAll(what)];
  const packed = Uint8Array.from(atob(document.getElementById("figures").textContent), (c) => c.charCodeAt(0));
  const figures = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
  // On paper the colours are those of the light page.
  const paper = { "--ink": "#1d2125", "--line": "#c9ced3", "--lighter": "0%" };
  let printing = false;
  const style = (name) => printing ? paper[name] : getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const config = { displayModeBar: false, responsive: true, scrollZoom: false };
  const cursor = { type: "line", xref: "x", yref: "paper", x0: 0, x1: 0, y0: 0, y1: 1, line: { color: "#d0407f", width: 1.5 } };
  const drawn = new Set();

  // A law's colour, lighter on a dark ground.
  function lighter(colour) {
    const share = parseFloat(style("--lighter")) / 100;
    const part = (at) => Math.round((1 - share) * parseInt(colour.slice(at, at + 2), 16) + share * 255).toString(16).padStart(2, "0");
    return `#${part(1)}${part(3)}${part(5)}`;
  }
  // The page's colours, light or dark.
  function themed({ data, layout }) {
    const inked = JSON.parse(JSON.stringify({ data, layout }).replaceAll('"color":"ink"', `"color":"${style("--ink")}"`));
    for (const { line, marker } of inked.data) for (const part of [line, marker]) {
      if (typeof part?.color === "string" && /^#.{6}$/.test(part.color) && part.color !== style("--ink")) part.color = lighter(part.color);
    }
    for (const key of new Set(["xaxis", "yaxis", ...Object.keys(layout).filter((each) => /^[xy]axis/.test(each))])) {
      inked.layout[key] = { ...inked.layout[key], gridcolor: style("--line"), zeroline: false };
    }
    Object.assign(inked.layout, { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest",
      font: { color: style("--ink"), family: "system-ui, sans-serif", size: 12 } });
    return inked;
  }
  // Nothing is drawn where it has no width: in what is folded.
  async function draw(home) {
    if (!home.offsetWidth) return;
    const first = !drawn.has(home), film = home.parentElement.querySelector(".film");
    if (first && film) figures[+home.dataset.figure].layout.shapes.push(cursor);
    const { data, layout } = themed(figures[+home.dataset.figure]);
    home.style.height = `${layout.height}px`;
    await Plotly.react(home, data, printing ? { ...layout, width: home.offsetWidth } : layout, config);
    drawn.add(home);
    if (first && film) join(film, home);
  }
  // A film, its controls and the curves below it have one time.
  function join(film, plot) {
    const video = film.querySelector("video"), button = film.querySelector("button");
    const slider = film.querySelector("input"), output = film.querySelector("output");
    const start = +video.dataset.start, speed = +video.dataset.speed;
    const last = figures[+plot.dataset.figure].layout.shapes.length - 1;
    const follow = () => {
      const time = start + speed * video.currentTime;
      slider.value = video.currentTime / video.duration || 0;
      output.textContent = `${time.toFixed(2)} s`;
      Plotly.relayout(plot, { [`shapes[${last}].x0`]: time, [`shapes[${last}].x1`]: time });
      if (!video.paused && !video.ended) requestAnimationFrame(follow);
    };
    const press = () => { if (video.paused) video.play(); else video.pause(); };
    button.addEventListener("click", press);
    video.addEventListener("click", press);
    slider.addEventListener("input", () => { video.pause(); video.currentTime = slider.value * video.duration; });
    for (const event of ["play", "pause", "ended"]) video.addEventListener(event, () => { button.textContent = video.paused ? "Play" : "Pause"; });
    for (const event of ["play", "seeked", "timeupdate"]) video.addEventListener(event, () => (event === "play" || video.paused) && follow());
    plot.on("plotly_click", (event) => { video.pause(); video.currentTime = Math.max(0, (event.points[0].x - start) / speed); });
  }

  all("details").forEach((each) => each.addEventListener("toggle", () => each.open && all(".plot", each).filter((home) => !drawn.has(home)).forEach(draw)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawn.forEach((home) => draw(home)));
  addEventListener("beforeprint", () => {
    printing = true;
    all("main details:not(.notices)").forEach((each) => { each.open = true; });
    document.documentElement.classList.add("paper");
    all(".plot").forEach((home) => draw(home));
    document.documentElement.classList.remove("paper");
  });
  addEventListener("afterprint", () => {
    printing = false;
    drawn.forEach((home) => draw(home));
  });
  for (const home of all(".plot")) await draw(home);
  document.documentElement.dataset.ready = "yes";
})();
