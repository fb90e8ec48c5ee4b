// The socket: samples and letters in, wishes out. It connects again when the server comes back.

import { unpack } from "./packing.js";

const AGAIN = 2000; // [ms]

export class Link {
  constructor(address, page) {
    this.address = Object.assign(new URL(address), { protocol: "ws:" });
    this.page = page;
    this.connect();
  }

  connect() {
    this.count = 0; // samples of this connection
    this.seen = this.page.received;
    this.socket = new WebSocket(this.address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        this.page.controls.letter(JSON.parse(data));
        return;
      }
      this.page.stats.bytes += data.byteLength;
      this.page.stats.samples += 1;
      this.page.take(unpack(data));
    };
    this.socket.onclose = async () => {
      this.page.controls.connected(false, await this.why());
      setTimeout(() => this.connect(), AGAIN);
    };
    this.socket.onopen = () => this.page.controls.connected(true);
  }

  // Why there is no connection: a socket that is refused does not say it, a request does.
  async why() {
    try {
      const answer = await fetch("icon.svg", { cache: "no-store" });
      if (answer.status === 403) return "the server was started anew: open the address that it printed";
      return answer.ok ? "the server takes no further page; trying again" : "not connected; trying again";
    } catch {
      return `not connected: no server at ${location.host}; trying again. Where it was started anew, open the address that it printed`;
    }
  }

  ask(wish) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wish));
  }

  drawn(received) {
    this.ask({ do: "drawn", samples: received - this.seen });
  }
}
