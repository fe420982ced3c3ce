// CAN frames for node programs over the socketcand protocol: { id, data } in and out, as node-canopen has them.
const EventEmitter = require('events');
const net = require('net');

class Socketcand extends EventEmitter {
  /** Resolves once the bus is shown. */
  static connect(port) {
    return new Promise((resolve, reject) => {
      const bus = new Socketcand(port);
      bus.once('open', () => resolve(bus));
      bus.socket.once('error', reject);
    });
  }

  constructor(port) {
    super();
    this.text = '';
    this.answers = ['< open can0 >', '< rawmode >'];
    this.socket = net.connect({ host: '127.0.0.1', port, noDelay: true });
    this.socket.setEncoding('ascii');
    this.socket.on('data', (text) => this._read(text));
    this.socket.on('close', () => this.emit('close'));
  }

  send({ id, data }) {
    const bytes = [...data].map((byte) => byte.toString(16)).join(' ');
    this.socket.write(`< send ${id.toString(16)} ${data.length} ${bytes} >`);
  }

  close() {
    this.socket.end();
  }

  _read(text) {
    this.text += text;
    for (let end; (end = this.text.indexOf('>')) >= 0;) {
      const words = this.text.slice(this.text.indexOf('<') + 1, end).trim().split(/\s+/);
      this.text = this.text.slice(end + 1);
      if (words[0] === 'hi' || (words[0] === 'ok' && this.answers.length))
        this.socket.write(this.answers.shift());
      else if (words[0] === 'ok')
        this.emit('open');
      else if (words[0] === 'frame')
        this.emit('frame', { id: parseInt(words[1], 16), data: Buffer.from(words[3] || '', 'hex') });
    }
  }
}

module.exports = { Socketcand };
