// The search runs in a worker, which a browser refuses to start from a page on a disk. Run it in a hidden frame there.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.url = String(url);
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.srcdoc = '<script>addEventListener("message",e=>{if(e.data&&e.data.load!==undefined){' +
        'self.importScripts=(...u)=>u.reduce((p,x)=>p.then(()=>new Promise((ok,no)=>{const s=document.createElement("script");' +
        's.src=x;s.onload=ok;s.onerror=no;document.body.append(s)})),Promise.resolve());' +
        'self.postMessage=(d)=>setTimeout(()=>parent.dispatchEvent(new MessageEvent("message",{data:d,source:self})));' +
        'importScripts(e.data.load).then(()=>parent.dispatchEvent(new MessageEvent("frame-ready",{source:self})))}})<\/script>';
      document.body.append(frame);
      frame.onload = () => {
        this.inner = frame.contentWindow;
        this.inner.dispatchEvent(new MessageEvent("message", { data: { load: this.url } }));
      };
      addEventListener("frame-ready", () => {
        this.ready = true;
        this.waiting.splice(0).forEach((data) => this.postMessage(data));
      });
      addEventListener("message", (event) => {
        if (event.source !== this.inner) return;
        const copy = new MessageEvent("message", { data: structuredClone(event.data) });  // as from a worker: nothing is shared
        this.dispatchEvent(copy);
        if (this.onmessage) this.onmessage(copy);
      });
    }
    postMessage(sent) {
      const data = structuredClone(sent);
      if (!this.ready) { this.waiting.push(data); return; }
      setTimeout(() => this.inner.dispatchEvent(new MessageEvent("message", { data })));  // as a worker: never at once
    }
    terminate() {}
  };
}
