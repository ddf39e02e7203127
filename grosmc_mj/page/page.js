"use strict";
(async () => {
  const bytesOf = (id) => Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  const data = await new Response(new Blob([bytesOf("data")]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
  const one = (what, within = document) => within.querySelector(what);
  const all = (what, within = document) => [...within.querySelectorAll(what)];
  const make = (tag, text = "", set = {}) => Object.assign(document.createElement(tag), { textContent: text, ...set });
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const narrow = () => innerWidth < 720;
  let paper = false;
  const said = (x) => (x == null ? "-" : typeof x === "string" ? x : String(+x.toPrecision(4)));
  // Plotly reads some tags in its texts; a name has none.
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const DASHES = { physics: "solid", corrected: "dash", printed: "dot" };
  const KEPT = "#0072B2", BROKEN = "#D55E00";
  const config = () => ({ displaylogo: false, responsive: true, scrollZoom: false,
    modeBarButtonsToRemove: ["toImage", "sendDataToCloud"], doubleClick: "reset" });
  const axis = (more) => ({ gridcolor: style("--line"), zeroline: false, automargin: true, ...more });
  const layout = (more) => ({ paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: style("--ink"), family: "system-ui, sans-serif", size: 12 }, hovermode: "closest",
    margin: { l: 60, r: 12, t: 26, b: 44 }, showlegend: false, ...more });
  // On a dark ground, dark colours are mixed with white.
  const colour = (hex) => {
    const parts = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    const light = 0.299 * parts[0] + 0.587 * parts[1] + 0.114 * parts[2];
    const white = dark.matches && light < 120 ? 0.45 : 0;
    return `rgb(${parts.map((x) => Math.round(x + white * (255 - x))).join(",")})`;
  };
  const pale = (rgb, share) => rgb.replace("rgb(", "rgba(").replace(")", `,${share})`);

  // Curves: panels over one time, which a slider, a film and a click set.
  function showCurves() {
    const plot = one("#curves-plot"), clock = one("#clock"), video = one("video"), film = one("#film");
    let shown, cursor = -1, time = 0, asked = 0, waiting = false, url = null;
    const off = { laws: new Set(), plants: new Set() };
    const boxes = (id, names) => {
      const home = one(`#${id}`);
      all("label", home).forEach((each) => each.remove());
      for (const [key, label] of Object.entries(names)) {
        const box = make("input", "", { type: "checkbox", checked: !off[id].has(key), value: key });
        box.addEventListener("change", () => { off[id][box.checked ? "delete" : "add"](key); draw(); });
        const around = make("label");
        around.append(box, ` ${label}`);
        // The legend: laws by their colours, plants by their lines.
        const line = { physics: "solid", corrected: "dashed", printed: "dotted" }[key] ?? "solid";
        around.style.borderBottom = id === "laws" ? `3px solid ${colour(shown.laws[key].colour)}` : `2px ${line} ${style("--soft")}`;
        home.append(around);
      }
    };
    const drawn = (panel) => panel.curves.filter((c) => !off.laws.has(c.law) && !off.plants.has(c.plant));
    const named = (c) => [shown.laws[c.law]?.label ?? c.law, shown.plants[c.plant], c.name].filter(Boolean).join(", ");
    function draw() {
      const traces = [], shapes = [], notes = [], axes = {}, count = shown.panels.length;
      shown.panels.forEach((panel, i) => {
        const y = i ? `y${i + 1}` : "y", gap = 0.22 / count, high = 1 / count;
        axes[`yaxis${i || ""}`.replace(/\d+$/, (n) => +n + 1)] = axis({ domain: [1 - (i + 1) * high + (i < count - 1 ? gap / 2 : 0), 1 - i * high - gap / 2] });
        notes.push({ text: plain(panel.label), x: 0, xref: "paper", y: 1 - i * high - gap / 2, yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false, font: { size: 12 } });
        for (const c of drawn(panel)) {
          const shade = colour(shown.laws[c.law]?.colour ?? "#888888"), physics = c.plant === "physics";
          const base = { xaxis: "x", yaxis: y, mode: "lines", name: plain(named(c)), meta: "curve" };
          if (c.range) traces.push({ ...base, x: [...c.t, ...c.t.slice().reverse()], y: [...c.range[1], ...c.range[0].slice().reverse()], fill: "toself", fillcolor: pale(shade, 0.25), line: { width: 0 }, hoverinfo: "skip", meta: "range" });
          traces.push({ ...base, x: c.t, y: c.y, line: { color: c.name === "true" ? style("--soft") : shade, width: physics ? 2.6 : 1.4, dash: c.name === "seen" ? "dot" : DASHES[c.plant] ?? "solid" }, hovertemplate: "%{y:.4g} at %{x:.3f} s<extra>" + plain(named(c)) + "</extra>" });
        }
        if (panel.reference) traces.push({ x: panel.reference.t, y: panel.reference.y, xaxis: "x", yaxis: y, mode: "lines", name: "reference", line: { color: style("--ink"), width: 1, dash: "dot" }, meta: "reference" });
        for (const limit of panel.limits) traces.push({ x: limit.t, y: limit.y, xaxis: "x", yaxis: y, mode: "lines", name: plain(limit.words), line: { color: style("--broken"), width: 1.4, dash: "longdash" }, meta: "limit" });
        if (panel.play) shapes.push({ type: "rect", xref: "paper", yref: y, x0: 0, x1: 1, y0: -panel.play / 2, y1: panel.play / 2, fillcolor: style("--soft"), opacity: 0.2, line: { width: 0 } });
      });
      for (const each of shown.disturbances) shapes.push({ type: "rect", xref: "x", yref: "paper", x0: each.start, x1: each.stop, y0: 0, y1: 1, fillcolor: "#009E73", opacity: 0.16, line: { width: 0 }, layer: "below", label: { text: narrow() ? "" : plain(each.label), textposition: "bottom left", font: { size: 11, color: style("--soft") } } });
      cursor = shapes.push({ type: "line", xref: "x", yref: "paper", x0: time, x1: time, y0: 0, y1: 1, line: { color: style("--cursor"), width: 1.5 } }) - 1;
      const kept = plot.layout?.xaxis?.range && plot.dataset.case === shown.title ? plot.layout.xaxis.range : [0, shown.duration];
      plot.dataset.case = shown.title;
      plot.style.height = `${Math.max(260, (narrow() ? 130 : 150) * count + 60)}px`;
      return Plotly.react(plot, traces, layout({ ...axes, shapes, annotations: notes, xaxis: axis({ title: { text: "time t [s]" }, range: kept, anchor: count > 1 ? `y${count}` : "y" }) }), config());
    }
    function say() {
      one("#clock-said").textContent = `${time.toFixed(3)} s`;
      clock.setAttribute("aria-valuetext", `${time.toFixed(3)} seconds`);
      if (one("#values").open) {
        const body = one("#values tbody");
        body.replaceChildren(...shown.panels.flatMap((panel) => drawn(panel).map((c) => {
          const row = make("tr");
          row.append(make("td", panel.label), make("td", named(c)), make("td", said(at(c))));
          return row;
        })));
      }
      if (cursor >= 0 && !waiting) {
        waiting = true;
        requestAnimationFrame(() => { waiting = false; Plotly.relayout(plot, { [`shapes[${cursor}].x0`]: time, [`shapes[${cursor}].x1`]: time }); });
      }
    }
    const at = (c) => {
      let low = 0, high = c.t.length - 1;
      if (high < 0 || time < c.t[0] || time > c.t[high]) return null;
      while (high - low > 1) { const middle = (low + high) >> 1; if (c.t[middle] <= time) low = middle; else high = middle; }
      const share = c.t[high] > c.t[low] ? (time - c.t[low]) / (c.t[high] - c.t[low]) : 0;
      return c.y[low] + share * (c.y[high] - c.y[low]);
    };
    function set(t, from) {
      time = Math.min(Math.max(t, 0), shown.duration);
      if (from !== clock) clock.value = time;
      if (from !== video && shown.film) {
        const wanted = Math.max(0, (time - shown.film.start) / shown.film.speed);
        video.currentTime = asked = Number.isFinite(video.duration) ? Math.min(wanted, video.duration) : wanted;
      }
      say();
    }
    const follow = () => shown.film && set(shown.film.start + shown.film.speed * video.currentTime, video);
    const play = () => { follow(); if (!video.paused && !video.ended) requestAnimationFrame(play); };
    function choose(index) {
      shown = data.cases[index];
      off.laws.clear(); off.plants.clear();
      boxes("laws", Object.fromEntries(Object.entries(shown.laws).map(([key, law]) => [key, law.label])));
      boxes("plants", shown.plants);
      one("#case-title").textContent = shown.title;
      clock.max = shown.duration; clock.step = shown.duration / 1000 || "any";
      film.hidden = !shown.film;
      if (url) URL.revokeObjectURL(url);
      url = null;
      if (shown.film) {
        const bytes = bytesOf(`film-${shown.film.number}`);
        video.src = url = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
      } else video.removeAttribute("src");
      time = 0;
      return draw().then(() => set(shown.film ? shown.film.start : 0));
    }
    one("#case").addEventListener("change", (event) => choose(+event.target.value));
    clock.addEventListener("input", () => { video.pause(); set(+clock.value, clock); });
    one("#values").addEventListener("toggle", say);
    video.addEventListener("play", play);
    // What the slider asked for is no news.
    for (const each of ["timeupdate", "seeked"]) video.addEventListener(each, () => { if (video.paused && Math.abs(video.currentTime - asked) > 1e-3) { asked = video.currentTime; follow(); } });
    choose(0).then(() => plot.on("plotly_click", (event) => { video.pause(); set(event.points[0].x); }));
    return draw;
  }

  // Claims: each opens to its figure; filters hide.
  function showClaims() {
    const entries = all(".claim");
    function figure(entry) {
      const { rows, threshold, sense, unit } = data.claims[+entry.dataset.index], home = one(".plot", entry);
      if (!rows.length) { home.hidden = true; return; }
      const values = [...rows.map((r) => r.value), threshold].filter((x) => x != null);
      const positive = values.every((x) => x > 0), wide = positive && Math.max(...values) > 30 * Math.min(...values);
      const good = (r) => threshold == null || (sense === "at most" ? r.value <= threshold : r.value >= threshold);
      const names = [...new Set(rows.map((r) => r.row))];
      home.style.height = `${90 + 26 * names.length}px`;
      Plotly.react(home, [{ type: "scatter", mode: "markers", x: rows.map((r) => r.value), y: rows.map((r) => plain(r.row)), text: rows.map((r) => plain(r.what)), hovertemplate: "%{x:.4g}, %{text}<extra>%{y}</extra>", marker: { size: 11, color: rows.map((r) => (good(r) ? colour(KEPT) : colour(BROKEN))), symbol: rows.map((r) => (good(r) ? "circle" : "x") + (r.what.startsWith("at half") ? "-open" : "")) } }],
        layout({ xaxis: axis({ title: { text: plain(`found${unit ? ` [${unit}]` : ""}; dashed: ${sense} ${said(threshold)}`) }, type: wide ? "log" : "linear" }), yaxis: axis({ autorange: "reversed", type: "category" }),
          shapes: threshold == null || (wide && threshold <= 0) ? [] : [{ type: "line", x0: threshold, x1: threshold, yref: "paper", y0: 0, y1: 1, line: { color: style("--ink"), dash: "dash", width: 1.2 } }] }), config());
    }
    entries.forEach((entry) => entry.addEventListener("toggle", () => entry.open && figure(entry)));
    const filters = all("[data-filter]");
    const filter = () => {
      entries.forEach((entry) => { entry.hidden = filters.some((f) => f.value && entry.dataset[f.dataset.filter] !== f.value); });
      one("#shown").textContent = `${entries.filter((e) => !e.hidden).length} of ${entries.length}`;
    };
    filters.forEach((each) => each.addEventListener("change", filter));
    return () => entries.filter((e) => e.open).forEach(figure);
  }

  // Campaigns: a plane of runs to brush in, and the distribution of one quantity.
  function showCampaign(home) {
    const campaign = data.campaigns[+home.dataset.index];
    const choice = (of, names, start) => {
      const select = one(`[data-of=${of}]`, home);
      names.forEach((name, i) => select.append(make("option", name, { value: i, selected: i === start })));
      select.addEventListener("change", () => draw());
      return select;
    };
    const { columns, units } = campaign, names = Object.keys(campaign.laws);
    const law = choice("law", names, names.length - 1), x = choice("x", columns, Math.min(1, columns.length - 1)), y = choice("y", columns, 0);
    const plot = one(".runs", home), margins = one(".margins", home), table = one(".chosen", home);
    const own = () => campaign.laws[names[+law.value]];
    const label = (i) => plain(columns[i] === "relative" ? "least margin [of its limit]" : columns[i] + (units[i] ? ` [${units[i]}]` : ""));
    function tell(i) {
      const command = `${campaign.command} ${own().ids[i]} --controller ${/^[\w.+-]+$/.test(names[+law.value]) ? names[+law.value] : `'${names[+law.value].replaceAll("'", `'"'"'`)}'`}`;
      const row = columns.map((name, k) => `${name} = ${said(own().points[k][i])}${units[k] ? ` ${units[k]}` : ""}`).join(", ");
      one(".replay", home).replaceChildren(make("b", `Run ${own().ids[i]}`), `: ${row}. To repeat it: `, make("code", command));
    }
    // Null is of a run that did not complete: nothing is worse.
    const size = (v) => (v == null ? -1e308 : v === "∞" ? 1e308 : v);
    function list(indices, words) {
      const key = own().points[columns.indexOf("relative")] ?? own().ids;
      const worst = [...indices].sort((a, b) => size(key[a]) - size(key[b]) || a - b).slice(0, 12);
      one("caption", table).textContent = words;
      const head = make("tr");
      ["run", ...columns].forEach((name) => head.append(make("th", name, { scope: "col" })));
      one("thead", table).replaceChildren(head);
      one("tbody", table).replaceChildren(...worst.map((i) => {
        const row = make("tr"), cell = make("td"), button = make("button", own().ids[i], { type: "button", ariaLabel: `Run ${own().ids[i]}` });
        button.addEventListener("click", () => tell(i));
        cell.append(button);
        row.append(cell, ...columns.map((_, k) => make("td", said(own().points[k][i]))));
        return row;
      }));
    }
    // Chosen by numbers, as by dragging; an end that is left empty is none.
    const ends = all("[data-end]", home), fill = (values) => ends.forEach((each, k) => { each.value = values[k] ?? ""; });
    function mark(chosen) {
      // At once: each call draws all runs again.
      const at = new Set(chosen), drawn = plot.data.flatMap((trace, k) => (trace.customdata ? [k] : []));
      Plotly.restyle(plot, { selectedpoints: drawn.map((k) => plot.data[k].customdata.flatMap((n, place) => (at.has(n) ? [place] : []))) }, drawn);
    }
    function choose() {
      const [left, right, low, high] = ends.map((each) => (each.value === "" ? null : +each.value));
      if (ends.every((each) => each.value === "")) return draw();
      const { points, ids } = own(), across = points[+x.value] ?? ids, up = points[+y.value] ?? ids;
      const within = (v, from, to) => (from == null || size(v) >= from) && (to == null || size(v) <= to);
      const chosen = ids.map((_, n) => n).filter((n) => within(across[n], left, right) && within(up[n], low, high));
      if (plot.layout.selections?.length) Plotly.relayout(plot, { selections: [] });
      mark(chosen);
      list(chosen, `The worst of ${chosen.length} chosen runs`);
    }
    ends.forEach((each) => each.addEventListener("input", choose));
    one(".brush button", home).addEventListener("click", () => draw());
    function draw() {
      fill([]);
      const { points, ids, runs, planes, histograms } = own(), i = +x.value, j = +y.value, key = points[columns.indexOf("relative")];
      const fails = ids.map((_, n) => !key || size(key[n]) < 0), traces = [];
      const plane = planes[`${Math.min(i, j)},${Math.max(i, j)}`];
      if (plane) {
        const wide = plane.x.length, tall = plane.y.length;
        let z = Array.from({ length: tall }, (_, r) => plane.counts.slice(r * wide, (r + 1) * wide)), sides = [plane.x, plane.y];
        if (i > j) { z = plane.x.map((_, c) => z.map((row) => row[c])); sides = [plane.y, plane.x]; }
        traces.push({ type: "heatmap", x: sides[0], y: sides[1], z: z.map((row) => row.map((n) => (n ? Math.log10(n) : null))), text: z, colorscale: [[0, pale(colour("#888888"), 0.12)], [1, pale(colour("#888888"), 0.7)]], showscale: false, hovertemplate: "%{text} runs<extra></extra>" });
      }
      for (const failing of [false, true]) {
        const at = ids.map((_, n) => n).filter((n) => fails[n] === failing);
        traces.push({ type: "scatter", mode: "markers", x: at.map((n) => points[i]?.[n]), y: at.map((n) => points[j]?.[n]), customdata: at, text: at.map((n) => `run ${ids[n]}`), hovertemplate: "%{text}: %{x:.4g}, %{y:.4g}<extra></extra>", name: failing ? "not kept" : "kept", selectedpoints: null, marker: { color: colour(failing ? BROKEN : KEPT), symbol: failing ? "x" : "circle", size: failing ? 7 : 5, opacity: 0.75 } });
      }
      plot.style.height = margins.style.height = "400px";
      Plotly.react(plot, traces, layout({ dragmode: "select", selections: [], showlegend: true, legend: { orientation: "h", y: 1.12 }, xaxis: axis({ title: { text: label(i) } }), yaxis: axis({ title: { text: label(j) } }) }), config());
      const bins = histograms[j];
      if (bins) Plotly.react(margins, [{ type: "bar", x: bins.x, y: bins.counts, marker: { color: bins.x.map((v) => colour(v < 0 && (columns[j] === "relative" || columns[j].startsWith("margin ")) ? BROKEN : KEPT)) }, hovertemplate: "%{y} runs at %{x:.4g}<extra></extra>" }], layout({ bargap: 0, xaxis: axis({ title: { text: label(j) + (bins.endless ? `; ${bins.endless} runs without one` : "") } }), yaxis: axis({ title: { text: "runs" } }) }), config());
      list(ids.keys(), `The worst of ${runs} runs${ids.length < runs ? `, of which ${ids.length} are drawn` : ""}; drag over the plane, or give its ends, to choose others`);
    }
    draw();
    plot.on("plotly_click", (event) => { const n = event.points.find((p) => p.customdata != null); if (n) tell(n.customdata); });
    plot.on("plotly_selected", (event) => { const chosen = event?.points.map((p) => p.customdata).filter((n) => n != null); if (!chosen?.length) return; fill([...(event.range?.x ?? []), ...(event.range?.y ?? [])].map((v) => +v.toPrecision(6))); list(chosen, `The worst of ${chosen.length} chosen runs`); });
    plot.on("plotly_deselect", draw);
    return draw;
  }

  // Studies: charts of three forms, one at a time.
  const SHADES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#888888"];
  const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down"];
  // Laws by rungs, imperfections or premises; blue is kept, red is not.
  function cells(chart) {
    const middle = dark.matches ? "#3a4046" : "#f4f4f4";
    return { high: 134 + 30 * chart.rows.length, wide: Math.min(900, 150 + 52 * chart.columns.length),
      traces: [{ type: "heatmap", x: chart.columns.map(plain), y: chart.rows.map(plain), z: chart.values, text: chart.texts.map((row) => row.map((each) => each && plain(each))), customdata: chart.whys.map((row) => row.map((w) => plain(w ?? ""))), texttemplate: "%{text}", zmin: -chart.most, zmax: chart.most, xgap: 2, ygap: 2, showscale: false,
        colorscale: dark.matches ? [[0, "#1f6fa8"], [0.5, middle], [1, "#b84f00"]] : [[0, "#7ab8e0"], [0.5, middle], [1, "#f0925a"]], hovertemplate: "%{y}, %{x}: %{text}<br>%{customdata}<extra></extra>" }],
      more: { xaxis: axis({ side: "top", type: "category", tickangle: -35, showgrid: false }), yaxis: axis({ autorange: "reversed", type: "category", showgrid: false }), margin: { l: 110, r: 70, t: 110, b: 8 } } };
  }
  // One quantity over another; what is asked for holds at a circle and not at a cross.
  function lines(chart) {
    const all = (key) => chart.lines.flatMap((line) => line[key]).filter((x) => x != null);
    const far = (values) => values.length > 0 && values.every((x) => typeof x === "number" && x > 0) && Math.max(...values) > 10 * Math.min(...values);
    const kind = (values) => (values.some((x) => typeof x === "string") ? "category" : far(values) ? "log" : "linear");
    const limited = chart.limit == null ? [] : [chart.limit], up = kind([...all("y"), ...limited]), across = kind(all("x"));
    const traces = chart.lines.map((line, i) => {
      const shade = colour(SHADES[i % SHADES.length]), judged = line.good.length > 0;
      return { type: "scatter", mode: across === "category" ? "markers" : "lines+markers", name: plain(line.name), x: line.x.map((x) => (typeof x === "string" ? plain(x) : x)), y: line.y, text: line.y.map((_, n) => plain(line.texts[n] ?? "")), line: { color: judged ? style("--soft") : shade, width: judged ? 1 : 2 }, hovertemplate: "%{y:.4g} at %{x} %{text}<extra>" + plain(line.name) + "</extra>",
        marker: { size: 9, color: judged ? line.good.map((good) => (good == null ? style("--soft") : colour(good ? KEPT : BROKEN))) : shade, symbol: judged ? line.good.map((good) => (good == null ? "circle-open" : good ? "circle" : "x")) : SYMBOLS[i % SYMBOLS.length] } };
    });
    const rule = { type: "line", line: { color: style("--ink"), dash: "dash", width: 1.2 } };
    const seen = (x, type) => type !== "log" || x > 0;
    const shapes = [...limited.filter((y) => seen(y, up)).map((y) => ({ ...rule, xref: "paper", x0: 0, x1: 1, y0: y, y1: y })),
      ...chart.marks.filter((x) => seen(x, across)).map((x) => ({ ...rule, line: { ...rule.line, dash: "dot" }, yref: "paper", y0: 0, y1: 1, x0: x, x1: x }))];
    const named = chart.lines.length > 1;
    return { high: paper ? 290 : named && narrow() ? 460 : 380, wide: 0, traces,
      more: { shapes, showlegend: named, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 64, r: 12, t: 40, b: 48 },
        xaxis: axis({ title: { text: plain(chart.titles[0]) }, type: across }), yaxis: axis({ title: { text: plain(chart.titles[1]) }, type: up, exponentformat: "power" }) } };
  }
  // A letter for each cell of a plane.
  function grid(chart) {
    const rows = chart.grid, legend = chart.legend, count = Math.max(1, legend.length), wide = Math.max(0, ...rows.map((row) => row.length));
    const number = new Map(legend.map((each, i) => [each.letter, i]));
    const middles = (end, n) => Array.from({ length: n }, (_, i) => end * ((2 * i + 1) / n - 1));
    const scale = legend.flatMap((each, i) => [[i / count, each.colour], [(i + 1) / count, each.colour]]);
    const z = rows.map((row) => Array.from({ length: wide }, (_, i) => number.get(row[i]) ?? null));
    const traces = [{ type: "heatmap", x: middles(chart.axes[0][1], wide), y: middles(chart.axes[1][1], rows.length), z, text: z.map((row) => row.map((i) => (i == null ? "" : plain(legend[i].name)))), zmin: -0.5, zmax: count - 0.5, showscale: false, hovertemplate: "%{text} from %{x:.4g}, %{y:.4g}<extra></extra>", ...(scale.length ? { colorscale: scale } : {}) },
      ...legend.map((each) => ({ type: "scatter", mode: "markers", x: [null], y: [null], name: plain(each.name), marker: { color: each.colour, symbol: "square", size: 12, line: { width: 1, color: style("--ink") } } }))];
    return { high: paper ? 290 : 460, wide: 0, traces, more: { showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 64, r: 12, t: 40, b: 48 },
      xaxis: axis({ title: { text: plain(chart.axes[0][0]) } }), yaxis: axis({ title: { text: plain(chart.axes[1][0]) } }) } };
  }
  const FORMS = { cells, lines, grid };
  function showSheet(home) {
    const charts = data.sheets[+home.dataset.index], plot = one(".plot", home), choice = one("select", home);
    const draw = () => {
      const chart = charts[choice ? +choice.value : 0], { high, wide, traces, more } = FORMS[chart.form](chart);
      plot.style.height = `${high}px`;
      plot.style.minWidth = wide ? `${wide}px` : "";
      return Plotly.react(plot, traces, layout(more), config());
    };
    choice?.addEventListener("change", draw);
    draw();
    return draw;
  }

  // A table that goes on below its edge shows so.
  for (const each of all(".short")) {
    const look = () => each.classList.toggle("more", each.scrollTop + each.clientHeight < each.scrollHeight - 2);
    each.addEventListener("scroll", look);
    addEventListener("resize", look);
    look();
  }

  const redraws = [];
  const begin = (there, show) => { if (there) redraws.push(show(there)); };
  begin(one("#curves"), showCurves);
  begin(one("#claims"), showClaims);
  // What lies below the first screens is drawn when it is nearly seen.
  const later = new Set(all(".sheet, .campaign").filter((each) => one(".plot", each)));
  const seen = new IntersectionObserver((found) => found.filter((each) => each.isIntersecting).forEach(({ target }) => show(target)), { rootMargin: "600px" });
  function show(home) {
    seen.unobserve(home);
    if (later.delete(home)) redraws.push(home.matches(".sheet") ? showSheet(home) : showCampaign(home));
  }
  later.forEach((each) => seen.observe(each));
  dark.addEventListener("change", () => redraws.forEach((draw) => draw()));
  // On paper there is nothing to open, and less width.
  addEventListener("beforeprint", () => {
    paper = true;
    later.forEach(show);
    all("main details:not(.notices), footer > details").forEach((each) => { each.dataset.was = each.open; each.open = true; });
    redraws.forEach((draw) => draw());
    all(".js-plotly-plot").forEach((each) => { each.style.minWidth = 0; Plotly.relayout(each, { width: each.closest(".pair") ? 640 : 680 }); });
  });
  addEventListener("afterprint", () => {
    paper = false;
    all("details[data-was]").forEach((each) => { each.open = each.dataset.was === "true"; });
    all(".js-plotly-plot").forEach((each) => Plotly.relayout(each, { autosize: true, width: null }));
    redraws.forEach((draw) => draw());
  });
  document.documentElement.dataset.ready = "yes";
})();
