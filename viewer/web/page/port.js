// In a cell of a notebook: samples and letters come from the page around, wishes go there.

import { unpack } from "./packing.js";

export class Port {
  constructor(page) {
    this.page = page;
    window.addEventListener("message", ({ source, data }) => source === window.parent && this.take(data));
    setTimeout(() => { // when the page is all there
      page.controls.connected(true);
      this.post({ open: true });
    });
  }

  post(message) {
    window.parent.postMessage(message, "*");
  }

  take(data) {
    const { page } = this;
    if (typeof data === "string") page.controls.letter(JSON.parse(data));
    else if (data instanceof ArrayBuffer) {
      page.stats.bytes += data.byteLength;
      page.stats.samples += 1;
      page.take(unpack(data));
    }
  }

  ask(wish) {
    this.post({ text: JSON.stringify(wish) });
  }

  drawn(received) {
    this.ask({ do: "drawn", samples: received });
  }
}
