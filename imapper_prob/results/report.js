// What the report does when somebody switches scenes, moves the slider or plays the motion.
(async () => {
  "use strict";
  const FLOOR = "floor", VIEW = "view", MAP = "map", HIDING = "hiding", CHAINS = "chains";
  const BEHIND = 50; // per cent from which a joint is said to be hidden
  const narrow = window.matchMedia("(max-width: 700px)").matches;
  const config = {
    responsive: true,
    displaylogo: false,
    displayModeBar: !narrow,
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
  };
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const at = (id) => document.getElementById(id);

  // plotly is packed, which halves the page.
  if (!window.DecompressionStream) {
    document.querySelector("main").prepend("This browser is too old for the plots. ");
    return;
  }
  const packed = Uint8Array.from(atob(at("plotly").textContent), (c) => c.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(unpacked).text();
  document.head.append(script);

  const moments = read("moments");
  const indices = {}; // by plot: numbers of its traces by what they are of
  let scene = 0, moment = 0, playing = null, asked = false;

  function draw(name) {
    const node = at(name);
    if (!node || indices[name]) return;
    const figure = read(`${name}-data`);
    indices[name] = { scene: [], bones: [], joints: [], seen: [] };
    figure.data.forEach((trace, number) => {
      const meta = trace.meta || {};
      if (meta.scene !== undefined) indices[name].scene.push([number, meta.scene]);
      if (meta.moves) indices[name][meta.moves].push(number);
    });
    // A finger that moves on a plot scrolls the page.
    if (narrow) figure.layout.dragmode = false;
    else figure.layout.margin.t = 36; // for the buttons above
    Plotly.newPlot(node, figure.data, figure.layout, config);
  }

  // Numbers of one person at the moment; `width` of them a joint.
  function part(values, person, width) {
    const length = moments.joints * width;
    const start = (moment * moments.people + person) * length;
    return values.slice(start, start + length);
  }

  function lines(points, width, across, along, scale) {
    const x = [], y = [];
    for (const [one, other] of moments.bones) {
      for (const joint of [one, other]) {
        const px = points[joint * width + across], py = points[joint * width + along];
        x.push(px === null ? null : px * scale);
        y.push(py === null ? null : py * scale);
      }
      x.push(null);
      y.push(null);
    }
    return [x, y];
  }

  function column(points, width, which, scale) {
    const values = [];
    for (let k = which; k < points.length; k += width) {
      values.push(points[k] === null ? null : points[k] * scale);
    }
    return values;
  }

  function hiddenNow() {
    const said = [];
    for (let person = 0; person < moments.people; person += 1) {
      const hidden = part(moments.hidden, person, 1);
      hidden.forEach((share, joint) => {
        if (share < BEHIND) return;
        let by = "", most = 0;
        moments.objects.forEach((object, number) => {
          const own = part(moments.by_object[number], person, 1)[joint];
          if (own > most) [by, most] = [object, own];
        });
        const whose = moments.people > 1 ? `${moments.names[person]}, ` : "";
        const told = share < 100 ? (share / 100).toFixed(2) : "> 0.99";
        said.push(`${whose}${moments.words[joint]} (${by ? `${by}, ` : ""}${told})`);
      });
    }
    return said.length ? `Probably hidden now: ${said.join("; ")}.` : "Probably nothing is hidden now.";
  }

  function showMoment() {
    asked = false;
    const drawn = moments.scenes[scene];
    const bones = { x: [], y: [] }, joints = { x: [], y: [] };
    const limbs = { x: [], y: [] }, points = { x: [], y: [], "marker.color": [] };
    const seen = { x: [], y: [], "marker.opacity": [] };
    for (let person = 0; person < moments.people; person += 1) {
      const world = part(drawn.joints, person, 3), image = part(drawn.pixels, person, 2);
      const found = part(moments.seen, person, 2), sure = part(moments.confidence, person, 1);
      const [x, y] = lines(world, 3, 0, 1, 0.01), [u, v] = lines(image, 2, 0, 1, 1);
      bones.x.push(x); bones.y.push(y);
      joints.x.push([column(world, 3, 0, 0.01)[moments.head]]);
      joints.y.push([column(world, 3, 1, 0.01)[moments.head]]);
      limbs.x.push(u); limbs.y.push(v);
      points.x.push(column(image, 2, 0, 1)); points.y.push(column(image, 2, 1, 1));
      points["marker.color"].push(part(moments.hidden, person, 1));
      seen.x.push(column(found, 2, 0, 1)); seen.y.push(column(found, 2, 1, 1));
      seen["marker.opacity"].push(sure.map((value) => value / 100));
    }
    Plotly.restyle(FLOOR, bones, indices[FLOOR].bones);
    Plotly.restyle(FLOOR, joints, indices[FLOOR].joints);
    Plotly.restyle(VIEW, limbs, indices[VIEW].bones);
    Plotly.restyle(VIEW, points, indices[VIEW].joints);
    Plotly.restyle(VIEW, seen, indices[VIEW].seen);
    const frame = moments.frames[moment];
    Plotly.relayout(HIDING, { "shapes[0].x0": frame, "shapes[0].x1": frame });
    at("time").value = moment;
    const text = `frame ${frame}, ${moments.seconds[moment].toFixed(1)} s`;
    at("now").textContent = text;
    at("time").setAttribute("aria-valuetext", text);
    at("hidden-now").textContent = hiddenNow();
  }

  function setMoment(number) {
    moment = Math.max(0, Math.min(number, moments.frames.length - 1));
    if (!asked) {
      asked = true;
      window.requestAnimationFrame(showMoment);
    }
  }

  function setScene(number) {
    scene = number;
    document.querySelectorAll("button[data-scene]").forEach((button) => {
      button.setAttribute("aria-pressed", String(Number(button.dataset.scene) === scene));
    });
    document.querySelectorAll("div[data-scene]").forEach((node) => {
      node.hidden = Number(node.dataset.scene) !== scene;
    });
    for (const name of [FLOOR, VIEW]) {
      const own = indices[name].scene;
      const shown = own.map(([, of]) => of === scene);
      Plotly.restyle(name, { visible: shown }, own.map(([trace]) => trace));
    }
    setMoment(moment);
  }

  function stop() {
    window.cancelAnimationFrame(playing);
    playing = null;
    at("play").textContent = "Play";
  }

  function play() {
    if (playing !== null) {
      stop();
      return;
    }
    const last = moments.frames.length - 1;
    if (moment >= last) setMoment(0);
    at("play").textContent = "Pause";
    // The time that has passed says which moment is shown: screens may be slower than the clip.
    const begun = window.performance.now(), first = moments.seconds[moment];
    const step = () => {
      const now = first + (window.performance.now() - begun) / 1000;
      let next = moment;
      while (next < last && moments.seconds[next + 1] <= now) next += 1;
      if (next !== moment) setMoment(next);
      if (next < last) playing = window.requestAnimationFrame(step);
      else stop();
    };
    playing = window.requestAnimationFrame(step);
  }

  [FLOOR, VIEW, MAP, HIDING].forEach(draw);
  document.querySelectorAll("button[data-scene]").forEach((button) => {
    button.addEventListener("click", () => setScene(Number(button.dataset.scene)));
  });
  at("time").addEventListener("input", (event) => {
    stop();
    setMoment(Number(event.target.value));
  });
  at("play").addEventListener("click", play);
  at(HIDING).on("plotly_click", (event) => {
    const frame = event.points[0].x;
    const gaps = moments.frames.map((own) => Math.abs(own - frame));
    stop();
    setMoment(gaps.indexOf(Math.min(...gaps)));
  });
  // A plot that is folded away has no size: it is drawn when it is first seen.
  document.querySelectorAll("details").forEach((node) => {
    node.addEventListener("toggle", () => {
      if (node.open && node.querySelector(`#${CHAINS}`)) draw(CHAINS);
    });
  });
  setScene(0);
})();
