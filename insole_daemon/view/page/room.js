// The size of a canvas, stored at layout: reading it while drawing would cause a new layout of the page.

// An opaque canvas with the pixels of the screen; `changed` is called when their number changes.
export class Room {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.ink = canvas.getContext("2d", { alpha: false });
    this.width = this.height = 0; // of the page's pixels
    this.ratio = 1;
    new ResizeObserver(([{ contentRect }]) => {
      this.ratio = devicePixelRatio;
      this.width = contentRect.width;
      this.height = contentRect.height;
      canvas.width = Math.round(this.width * this.ratio);
      canvas.height = Math.round(this.height * this.ratio);
      changed();
    }).observe(canvas);
  }
}
