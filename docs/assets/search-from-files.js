// SPDX-License-Identifier: MIT
// Search in a site that is opened from the disk: browsers start no workers from file:// addresses. The worker's script then
// runs in a hidden frame that stands for it. Served over http, this does nothing.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      this.ready = new Promise((resolve) => frame.addEventListener("load", resolve, { once: true })).then(() => {
        this.inside = frame.contentWindow;
        this.inside.postMessage = (data) => this.answer(data);
        this.inside.importScripts = async (...addresses) => {
          for (const one of addresses) await this.load(one);
        };
        return this.load(address);
      });
      document.body.append(frame);
      this.frame = frame;
    }

    load(address) {
      return new Promise((resolve, reject) => {
        const script = this.inside.document.createElement("script");
        script.src = new URL(address, document.baseURI).href;
        script.onload = resolve;
        script.onerror = reject;
        this.inside.document.head.append(script);
      });
    }

    answer(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }

    async postMessage(data) {
      await this.ready;
      this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data }));
    }

    terminate() {
      this.frame.remove();
    }
  };
}
