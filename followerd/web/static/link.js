// The socket to the robot: opened again and again, and quick to say that it is gone.
const AGAIN = 500;        // ms before another try
const SILENCE = 1500;     // ms without a word after which the robot counts as gone
const ALIVE = 200;        // ms between two signs of life

// s of the wall clock
export const now = () => (performance.timeOrigin + performance.now()) / 1000;

export class Link {
  constructor(handlers) {
    this.handlers = handlers;   // opened, picture, track, state, you, answer, gone, locked
    this.socket = null;
    this.heard = 0;
    setInterval(() => this.watch(), ALIVE);
    this.open();
  }

  async open() {
    try {
      const token = location.hash.slice(1) || sessionStorage.getItem('token') || '';
      const answer = await fetch('session', { method: 'POST', body: token });
      if (answer.status === 401) { this.handlers.locked(token !== ''); return; }
      if (!answer.ok) throw new Error(answer.statusText);
      if (token) { sessionStorage.setItem('token', token); history.replaceState(null, '', location.pathname); }
      const scheme = location.protocol === 'https:' ? 'wss:' : 'ws:';
      const socket = new WebSocket(`${scheme}//${location.host}/ws`);
      socket.binaryType = 'arraybuffer';
      socket.onmessage = event => this.take(event.data);
      socket.onclose = () => { if (this.socket === socket) this.lost(); };
      this.socket = socket;
      this.heard = performance.now();
      this.handlers.opened();
    } catch {
      this.lost();
    }
  }

  lost() {
    this.socket = null;
    this.handlers.gone();
    setTimeout(() => this.open(), AGAIN);
  }

  watch() {
    if (!this.socket) return;
    if (performance.now() - this.heard > SILENCE) {
      const silent = this.socket;
      this.lost();
      silent.close();
    } else {
      this.send({ do: 'alive' });
    }
  }

  take(data) {
    this.heard = performance.now();
    if (data instanceof ArrayBuffer) {
      const view = new DataView(data);
      this.handlers.picture({
        frame: view.getUint32(4, true),
        exposed: view.getFloat64(8, true),
        received: view.getFloat64(16, true),
        sent: view.getFloat64(24, true),
        arrived: now(),
        jpeg: new Blob([new Uint8Array(data, 32)], { type: 'image/jpeg' }),
      });
      return;
    }
    const message = JSON.parse(data);
    if ('track' in message) this.handlers.track(message.track);
    else if ('state' in message) this.handlers.state(message.state);
    else if ('you' in message) this.handlers.you(message);
    else if ('answer' in message) this.handlers.answer(message.answer);
  }

  send(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
