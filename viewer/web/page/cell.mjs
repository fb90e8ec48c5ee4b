// A cell of a notebook (anywidget): the page in a frame, and its messages to and from the kernel.

export default {
  render({ model, el }) {
    const frame = document.createElement("iframe"), name = `${Math.random()}`.slice(2);
    Object.assign(frame, { title: "skin", srcdoc: model.get("content") });
    frame.setAttribute("sandbox", "allow-scripts allow-downloads");
    frame.style.cssText = `width: 100%; height: ${model.get("height")}px; border: 1px solid #dde1e6; border-radius: 6px;`;
    const fromFrame = ({ source, data }) => source === frame.contentWindow && model.send({ from: name, ...data });
    const fromKernel = (content, buffers) => {
      if (content.to !== name) return;
      const bytes = buffers?.[0];
      frame.contentWindow?.postMessage(content.text ?? new Uint8Array(bytes.buffer ?? bytes, bytes.byteOffset ?? 0, bytes.byteLength).slice().buffer, "*");
    };
    window.addEventListener("message", fromFrame);
    model.on("msg:custom", fromKernel);
    el.append(frame);
    return () => {
      window.removeEventListener("message", fromFrame);
      model.off("msg:custom", fromKernel);
      model.send({ from: name, close: true });
    };
  },
};
