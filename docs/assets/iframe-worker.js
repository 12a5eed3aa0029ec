/* Browsers start no workers from file://, and the site's search is one. Here a hidden frame stands in for it: the worker's script runs
 * in the frame, and messages are handed over. Only what the search needs; from a server, real workers are used. */
"use strict";

class IFrameWorker extends EventTarget {
  constructor(address) {
    super();
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    document.body.appendChild(this.frame);
    const inside = this.frame.contentWindow;
    inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
    this.ready = new Promise((resolve, reject) => {
      const script = inside.document.createElement("script");
      script.addEventListener("load", () => resolve(inside));
      script.addEventListener("error", () => reject(new Error(`the search cannot load ${address}`)));
      script.src = address;
      inside.document.body.appendChild(script);
    });
  }

  postMessage(data) {
    this.ready.then((inside) => inside.dispatchEvent(new MessageEvent("message", { data })));
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:") {
  window.IFrameWorker = IFrameWorker; // by this name the search knows that it is in a frame
  window.Worker = IFrameWorker;
}
