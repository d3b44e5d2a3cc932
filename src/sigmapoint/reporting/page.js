"use strict";
/* Draws the figures of the page: their data are JSON beside them, their colours follow the page. */
(function () {
  const graphs = Array.from(document.querySelectorAll(".graph"));
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const specification = (graph) => JSON.parse(document.getElementById(graph.id + "-data").textContent);
  const buttons = [["zoom2d", "pan2d", "resetScale2d", "toImage"]];
  const config = { responsive: true, displaylogo: false, displayModeBar: "hover", modeBarButtons: buttons };
  if (touch) config.displayModeBar = false;

  function axis(own) {
    const lines = { gridcolor: color("--grid"), zerolinecolor: color("--line"), linecolor: color("--line") };
    return Object.assign({ automargin: true, ticks: "" }, lines, own, { title: Object.assign({ standoff: 8 }, own.title) });
  }

  function dressed(layout) {
    const narrow = window.innerWidth < 560;
    return Object.assign({}, layout, {
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: color("--ink"), size: narrow ? 11 : 12, family: getComputedStyle(document.body).fontFamily },
      margin: { l: narrow ? 44 : 56, r: 14, t: 14, b: 40 },
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)" },
      hoverlabel: { bgcolor: color("--card"), bordercolor: color("--line"), font: { color: color("--ink") } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: color("--soft"), activecolor: color("--accent"), orientation: "h" },
      dragmode: touch ? false : "zoom",
      uirevision: "kept",
      xaxis: axis(layout.xaxis || {}),
      yaxis: axis(layout.yaxis || {}),
    });
  }

  function draw(graph) {
    const made = specification(graph);
    return Plotly.react(graph, made.data, dressed(made.layout), config);
  }

  /* Zooming one time series zooms all of them. */
  let following = false;
  function follow(source, change) {
    if (following) return;
    let update = null;
    if ("xaxis.range[0]" in change) update = { "xaxis.range": [change["xaxis.range[0]"], change["xaxis.range[1]"]] };
    if ("xaxis.range" in change) update = { "xaxis.range": change["xaxis.range"] };
    if ("xaxis.autorange" in change) update = { "xaxis.autorange": true };
    if (update === null) return;
    following = true;
    const others = graphs.filter((g) => g !== source && g.layout && g.layout.meta && g.layout.meta.series);
    Promise.all(others.map((g) => Plotly.relayout(g, update))).finally(() => { following = false; });
  }

  function next(i) {
    if (i === graphs.length) return;
    draw(graphs[i]).then((graph) => {
      if (graph.layout.meta && graph.layout.meta.series) graph.on("plotly_relayout", (change) => follow(graph, change));
      setTimeout(next, 0, i + 1);
    });
  }

  next(0);
  const redraw = () => graphs.filter((g) => g.layout).forEach(draw);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
})();
