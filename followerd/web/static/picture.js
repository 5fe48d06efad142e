// The camera's newest picture, what the tracker made of it, and the click that enrols.
import { now } from './link.js';

const KEPT = 1000;  // times of pictures
const SHORT = 8;   // px of the screen: a shorter drag is a click
const COLOURS = { confirmed: '#35d07f', tentative: '#f2b134', occluded: '#f2b134', lost: '#ff4d4d' };

export class Picture {
  constructor(canvas, link, enrol) {
    this.canvas = canvas;
    this.link = link;
    this.enrol = enrol;
    this.track = null;
    this.image = null;
    this.frame = null;
    this.drag = null;
    this.round = false;     // the tracker follows a head: its box is that of an ellipse
    this.pending = null;    // a drawing that is due
    this.drawn = 0;
    this.times = [];        // exposed, received, sent, arrived, decoded, drawn: of the newest pictures, s
    canvas.addEventListener('pointerdown', event => this.begin(event));
    canvas.addEventListener('pointermove', event => this.move(event));
    canvas.addEventListener('pointerup', event => this.end(event));
    canvas.addEventListener('pointercancel', () => { this.drag = null; });
  }

  async show(picture) {
    try {
      const image = await createImageBitmap(picture.jpeg);
      const decoded = now();
      this.image?.close();
      this.image = image;
      this.frame = picture.frame;
      if (this.canvas.width !== image.width || this.canvas.height !== image.height) {
        this.canvas.width = image.width;
        this.canvas.height = image.height;
      }
      this.draw();
      this.drawn += 1;
      const { exposed, received, sent, arrived } = picture;
      this.times.push([exposed, received, sent, arrived, decoded, now()]);
      if (this.times.length > KEPT) this.times.shift();
    } finally {
      this.link.send({ do: 'ack', frame: picture.frame });
    }
  }

  // a track is drawn with the picture that follows it, or alone when none does
  mark(track) {
    this.track = track;
    this.pending ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    if (this.pending) cancelAnimationFrame(this.pending);
    this.pending = null;
    const { canvas, image, track } = this;
    if (!image) return;
    const c = canvas.getContext('2d');
    c.drawImage(image, 0, 0);
    const unit = Math.max(1, canvas.width / 320);
    if (track) {
      c.lineWidth = unit;
      c.strokeStyle = '#fff6';
      for (const box of track.candidates ?? []) this.frameOf(c, box);
      c.fillStyle = '#5cf8';
      if (track.box) for (const [x, y] of track.particles ?? []) c.fillRect(x - unit / 2, y - unit / 2, unit, unit);
      for (const [x, y, w, h, like] of track.patches ?? []) {
        c.strokeStyle = like === null ? '#fff3' : `hsl(${120 * Math.max(0, Math.min(1, 2 * like - 1))} 90% 55% / .7)`;
        c.strokeRect(x, y, w, h);
      }
      if (track.box) {
        const colour = COLOURS[track.phase] ?? '#fff';
        c.lineWidth = 2 * unit;
        c.strokeStyle = colour;
        if (this.round) this.ellipse(c, track.box); else this.frameOf(c, track.box);
        this.label(c, track, colour, unit);
      }
    }
    if (this.drag) {
      c.lineWidth = 2 * unit;
      c.strokeStyle = '#5cf';
      this.frameOf(c, this.boxOf(this.drag));
    }
  }

  ellipse(c, [x, y, w, h]) {
    c.beginPath();
    c.ellipse(x + w / 2, y + h / 2, w / 2, h / 2, 0, 0, 2 * Math.PI);
    c.stroke();
  }

  label(c, track, colour, unit) {
    const sure = track.confidence === null ? '' : ` ${Math.round(100 * track.confidence)} %`;
    const size = Math.max(9, 10 * unit), text = track.phase + sure;
    c.font = `${size}px system-ui, sans-serif`;
    const x = Math.max(0, Math.min(track.box[0], this.canvas.width - c.measureText(text).width - 4));
    const y = Math.max(size + 2, track.box[1] - 3);
    c.fillStyle = '#000a';
    c.fillRect(x, y - size, c.measureText(text).width + 4, size + 3);
    c.fillStyle = colour;
    c.fillText(text, x + 2, y);
  }

  frameOf(c, box) {
    if (box) c.strokeRect(box[0], box[1], box[2], box[3]);
  }

  place(event) {
    const area = this.canvas.getBoundingClientRect();
    return [
      (event.clientX - area.left) * this.canvas.width / area.width,
      (event.clientY - area.top) * this.canvas.height / area.height,
    ];
  }

  begin(event) {
    if (this.frame === null) return;
    const at = this.place(event);
    // the picture that is on the screen now is the one that is meant, however long the drag takes
    this.drag = { from: at, to: at, frame: this.frame, x: event.clientX, y: event.clientY };
    this.canvas.setPointerCapture(event.pointerId);
  }

  move(event) {
    if (!this.drag) return;
    this.drag.to = this.place(event);
    this.draw();
  }

  end(event) {
    const drag = this.drag;
    if (!drag) return;
    this.drag = null;
    const far = Math.hypot(event.clientX - drag.x, event.clientY - drag.y);
    this.enrol(far < SHORT ? drag.from : this.boxOf(drag), drag.frame);
    this.draw();
  }

  boxOf({ from, to }) {
    return [
      Math.min(from[0], to[0]), Math.min(from[1], to[1]),
      Math.max(1, Math.abs(from[0] - to[0])), Math.max(1, Math.abs(from[1] - to[1])),
    ];
  }
}
