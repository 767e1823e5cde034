// The list of numbers: a slider and a field for each, in groups. Values are set without touching the
// field that has the focus.
export class NumberList {
  constructor(element, changed) {
    this.element = element;
    this.changed = changed;
    this.rows = new Map();
    this.layout = "";
  }

  show(numbers) {
    const layout = JSON.stringify(numbers.map((one) => [one.path, one.group]));
    if (layout !== this.layout) this.build(numbers, layout);
    for (const one of numbers) {
      const row = this.rows.get(JSON.stringify(one.path));
      if (row.slider !== row.moving) row.slider.value = one.value;
      if (document.activeElement !== row.field) row.field.value = Number(one.value.toPrecision(6));
    }
  }

  build(numbers, layout) {
    this.layout = layout;
    this.rows.clear();
    const groups = new Map();
    for (const one of numbers) {
      if (!groups.has(one.group)) groups.set(one.group, this.group(one.group, groups.size));
      groups.get(one.group).append(this.row(one));
    }
    this.element.replaceChildren(...groups.values());
    if (numbers.length === 0) this.element.textContent = "This part file has no numbers to move.";
  }

  group(name, index) {
    const group = document.createElement("details"), title = document.createElement("summary");
    group.className = "group";
    group.open = index < 4;
    title.textContent = name;
    group.append(title);
    return group;
  }

  row(one) {
    const row = document.createElement("label"), name = document.createElement("span");
    const slider = document.createElement("input"), field = document.createElement("input");
    const unit = document.createElement("span");
    row.className = "number";
    name.textContent = one.label.replaceAll("_mm", "").replaceAll("_deg", "").replaceAll("_", " ");
    unit.textContent = one.unit;
    slider.type = "range";
    Object.assign(slider, { min: one.low, max: one.high, step: one.step });
    field.type = "number";
    field.step = "any";
    slider.ariaLabel = `${one.group} ${one.label}`;
    field.ariaLabel = `${one.group} ${one.label}, typed`;
    const kept = { slider, field, moving: null };
    slider.oninput = () => {
      const continuing = kept.moving === slider;
      kept.moving = slider;
      this.changed(one.path, Number(slider.value), continuing);
    };
    slider.onchange = () => { kept.moving = null; };
    field.onchange = () => {
      if (field.value !== "") this.changed(one.path, Number(field.value), false);
    };
    this.rows.set(JSON.stringify(one.path), kept);
    row.append(name, slider, field, unit);
    return row;
  }
}
