// Range, bearing, speed and confidence of the last half minute.
const SECONDS = 30;
const ROWS = [
  { name: 'range, m', low: 0, high: 4, of: (s, t) => t?.range },
  { name: 'bearing, °', low: -40, high: 40, of: (s, t) => t?.bearing == null ? null : t.bearing * 180 / Math.PI },
  { name: 'speed, m/s', low: -0.2, high: 1, of: s => s.command?.[0] },
  { name: 'confidence', low: 0, high: 1, of: (s, t) => t?.confidence },
];

export class Strips {
  constructor(canvas) {
    this.canvas = canvas;
    this.samples = [];
  }

  show(state, track) {
    if (state.now == null) return;
    this.samples.push({ at: state.now, values: ROWS.map(row => row.of(state, track) ?? null) });
    while (this.samples.length && this.samples[0].at < state.now - SECONDS) this.samples.shift();
    this.draw(state.now);
  }

  draw(now) {
    const { canvas } = this;
    const c = canvas.getContext('2d');
    const height = canvas.height / ROWS.length;
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.font = '12px system-ui, sans-serif';
    ROWS.forEach((row, i) => {
      const top = i * height;
      const y = value => top + height - 4 - (height - 18) * (Math.min(row.high, Math.max(row.low, value)) - row.low) / (row.high - row.low);
      c.strokeStyle = '#fff3';
      c.strokeRect(0.5, top + 0.5, canvas.width - 1, height - 1);
      const last = this.samples[this.samples.length - 1]?.values[i];
      c.fillStyle = '#ccd';
      c.fillText(`${row.name}  ${last == null ? '–' : last.toFixed(2)}`, 6, top + 13);
      c.strokeStyle = '#35d07f';
      c.beginPath();
      let pen = false;
      for (const sample of this.samples) {
        const value = sample.values[i];
        if (value === null) { pen = false; continue; }
        const x = canvas.width * (1 - (now - sample.at) / SECONDS);
        if (pen) c.lineTo(x, y(value)); else c.moveTo(x, y(value));
        pen = true;
      }
      c.stroke();
    });
  }
}
