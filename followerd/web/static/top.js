// From above, the robot in the middle and looking up: scan, person, particles, trails, the guard's
// fields, stream lines of the robot (blue) and ways the person may take (yellow).
const TRAIL = 400;   // places kept

export class Top {
  constructor(canvas) {
    this.canvas = canvas;
    this.metres = 4;      // from the middle to the edge
    this.state = null;
    this.track = null;
    this.robotTrail = [];
    this.personTrail = [];
    this.pinch = null;
    this.body = null;     // of the robot, and what the guard keeps free
    this.walls = [];      // of the map
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      this.zoom(Math.exp(0.001 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener('touchmove', event => this.pinched(event), { passive: false });
    canvas.addEventListener('touchend', () => { this.pinch = null; });
  }

  async furnish() {
    const answer = await fetch('scene');
    if (answer.ok) Object.assign(this, await answer.json());
  }

  zoom(factor) {
    this.metres = Math.min(12, Math.max(1.5, this.metres * factor));
    this.draw();
  }

  pinched(event) {
    if (event.touches.length !== 2) return;
    event.preventDefault();
    const [a, b] = event.touches;
    const apart = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    if (this.pinch) this.zoom(this.pinch / apart);
    this.pinch = apart;
  }

  show(state, track) {
    this.state = state;
    this.track = track;
    if (state.base) this.keep(this.robotTrail, state.base);
    if (track?.position) this.keep(this.personTrail, track.position);
    this.draw();
  }

  keep(trail, place) {
    const last = trail[trail.length - 1];
    if (last && Math.hypot(last[0] - place[0], last[1] - place[1]) < 0.03) return;
    trail.push([place[0], place[1]]);
    if (trail.length > TRAIL) trail.shift();
  }

  draw() {
    const { canvas, state, track } = this;
    const c = canvas.getContext('2d');
    const middle = canvas.width / 2, scale = middle / this.metres;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    this.rings(c, middle, scale);
    if (!state?.base) return;
    const [x0, y0, heading] = state.base;
    const cos = Math.cos(heading), sin = Math.sin(heading);
    const at = ([x, y]) => {
      const dx = x - x0, dy = y - y0;
      const ahead = cos * dx + sin * dy, left = cos * dy - sin * dx;
      return [middle - left * scale, middle - ahead * scale];
    };
    this.map(c, at, state.map_from_odom);
    this.field(c, middle, scale, state);
    this.line(c, this.robotTrail.map(at), '#5cf8');
    this.line(c, this.personTrail.map(at), '#35d07f88');
    c.fillStyle = '#e55';
    for (const [x, y] of state.scan ?? []) {
      const [u, v] = at([x / 100, y / 100]);
      c.fillRect(u - 1.5, v - 1.5, 3, 3);
    }
    c.strokeStyle = '#fc6';
    for (const [x, y] of state.legs ?? []) {
      const [u, v] = at([x / 100, y / 100]);
      c.beginPath();
      c.arc(u, v, Math.max(3, 0.08 * scale), 0, 2 * Math.PI);
      c.stroke();
    }
    for (const line of state.lines ?? []) this.line(c, line.map(([x, y]) => at([x / 100, y / 100])), '#5cf4', 1);
    for (const line of state.courses ?? []) this.line(c, line.map(([x, y]) => at([x / 100, y / 100])), '#fc68', 1);
    c.fillStyle = '#5cf8';
    if (!track?.box) for (const place of track?.particles ?? []) c.fillRect(...at(place), 2, 2);
    this.way(c, (state.way ?? []).map(at));
    if (track?.position) this.person(c, at(track.position), scale, track, heading);
    this.robot(c, middle, scale, state);
  }

  rings(c, middle, scale) {
    c.strokeStyle = '#fff3';
    c.fillStyle = '#ccd';
    c.font = '12px system-ui, sans-serif';
    for (let r = 1; r <= this.metres; r += 1) {
      c.beginPath();
      c.arc(middle, middle, r * scale, 0, 2 * Math.PI);
      c.stroke();
      c.fillText(`${r} m`, middle + 3, middle - r * scale - 2);
    }
  }

  map(c, at, placed) {
    if (!placed) return;
    const [x0, y0, theta] = placed, cos = Math.cos(theta), sin = Math.sin(theta);
    const inOdom = (x, y) => [cos * (x - x0) + sin * (y - y0), cos * (y - y0) - sin * (x - x0)];
    c.strokeStyle = '#9ab';
    c.beginPath();
    for (const [x1, y1, x2, y2] of this.walls) {
      c.moveTo(...at(inOdom(x1, y1)));
      c.lineTo(...at(inOdom(x2, y2)));
    }
    c.stroke();
  }

  // what the guard keeps free ahead at this speed: braking way and margin
  field(c, middle, scale, state) {
    const { body } = this, v = state.command?.[0] ?? 0;
    if (!body || v <= 0) return;
    const stop = v * body.reaction + v * v / (2 * body.deceleration) + body.margin;
    const half = (body.half_width + body.side) * scale;
    c.fillStyle = '#5cf2';
    c.fillRect(middle - half, middle - (body.front + stop) * scale, 2 * half, stop * scale);
  }

  way(c, points) {
    if (!points.length) return;
    this.line(c, points, '#fc6');
    const [u, v] = points[points.length - 1];
    c.strokeStyle = '#fc6';
    c.strokeRect(u - 5, v - 5, 10, 10);
  }

  line(c, points, colour, width = 2) {
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.beginPath();
    for (const [u, v] of points) c.lineTo(u, v);
    c.stroke();
    c.lineWidth = 1;
  }

  person(c, [u, v], scale, track, heading) {
    c.fillStyle = track.phase === 'confirmed' ? '#35d07f' : '#f2b134';
    c.beginPath();
    c.arc(u, v, Math.max(5, 0.2 * scale), 0, 2 * Math.PI);
    c.fill();
    const p = track.covariance;
    if (!p) return;
    const [a, b, , d] = p;
    const mean = (a + d) / 2, apart = Math.hypot((a - d) / 2, b);
    const turn = 0.5 * Math.atan2(2 * b, a - d);
    c.save();
    c.translate(u, v);
    c.rotate(-(turn - heading) - Math.PI / 2);   // odom's x axis points up when the heading is 0
    c.strokeStyle = '#f2b134';
    c.beginPath();
    c.ellipse(0, 0, 2 * scale * Math.sqrt(Math.max(0, mean + apart)),
              2 * scale * Math.sqrt(Math.max(0, mean - apart)), 0, 0, 2 * Math.PI);
    c.stroke();
    c.restore();
  }

  robot(c, middle, scale, state) {
    const { front, rear, half_width: half } = this.body ?? { front: 0.21, rear: 0.3, half_width: 0.21 };
    c.fillStyle = '#5cf';
    c.fillRect(middle - half * scale, middle - front * scale, 2 * half * scale, (front + rear) * scale);
    c.fillStyle = '#024';
    c.beginPath();
    c.moveTo(middle, middle - front * scale);
    c.lineTo(middle - 0.7 * half * scale, middle);
    c.lineTo(middle + 0.7 * half * scale, middle);
    c.fill();
    const [v, omega] = state.command ?? [0, 0];
    if (!v && !omega) return;
    c.strokeStyle = '#fff';
    c.lineWidth = 2;
    c.beginPath();
    let x = 0, y = 0, theta = 0;
    c.moveTo(middle, middle);
    for (let k = 0; k < 20; k += 1) {
      x += v * 0.075 * Math.cos(theta);
      y += v * 0.075 * Math.sin(theta);
      theta += omega * 0.075;
      c.lineTo(middle - y * scale, middle - x * scale);
    }
    c.stroke();
    c.lineWidth = 1;
  }
}
