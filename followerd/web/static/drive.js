// Driving by hand: what is asked for is said again and again, and nothing once the hand lets go.
const PERIOD = 50;   // ms
const KEYS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

export class Drive {
  constructor(pad, stick, link) {
    this.pad = pad;
    this.stick = stick;
    this.knob = stick.querySelector('span');
    this.link = link;
    this.active = false;
    this.held = null;          // [forward, left] of the pointer
    this.keys = new Set();
    stick.addEventListener('pointerdown', event => { stick.setPointerCapture(event.pointerId); this.move(event); });
    stick.addEventListener('pointermove', event => { if (this.held) this.move(event); });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) stick.addEventListener(end, () => this.release());
    window.addEventListener('keydown', event => this.key(event, true));
    window.addEventListener('keyup', event => this.key(event, false));
    window.addEventListener('blur', () => { this.keys.clear(); this.release(); });
    document.addEventListener('visibilitychange', () => { if (document.hidden) { this.keys.clear(); this.release(); } });
    setInterval(() => this.say(), PERIOD);
  }

  show(active) {
    this.active = active;
    this.pad.hidden = !active;
    if (!active) { this.keys.clear(); this.release(); }
  }

  key(event, down) {
    if (!this.active || !(event.key in KEYS)) return;
    event.preventDefault();
    if (down) this.keys.add(event.key); else this.keys.delete(event.key);
  }

  move(event) {
    if (!this.active) return;
    const area = this.stick.getBoundingClientRect(), radius = area.width / 2;
    let x = (event.clientX - area.left - radius) / radius, y = (event.clientY - area.top - radius) / radius;
    const far = Math.max(1, Math.hypot(x, y));
    x /= far; y /= far;
    this.held = [-y, -x];
    this.knob.style.transform = `translate(${x * radius * 0.7}px, ${y * radius * 0.7}px)`;
  }

  release() {
    this.held = null;
    this.knob.style.transform = '';
  }

  say() {
    if (!this.active) return;
    let wanted = this.held;
    if (!wanted && this.keys.size) {
      wanted = [0, 0];
      for (const key of this.keys) { wanted[0] += KEYS[key][0]; wanted[1] += KEYS[key][1]; }
    }
    if (wanted) this.link.send({ do: 'drive', forward: clip(wanted[0]), left: clip(wanted[1]) });
  }
}

const clip = value => Math.min(1, Math.max(-1, value));
