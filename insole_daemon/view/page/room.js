// The room of a canvas, kept as the page is laid out: asking for it while drawing would lay the page out anew.

// An opaque canvas with as many pixels as the screen has there; `changed` is called when they are others.
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
