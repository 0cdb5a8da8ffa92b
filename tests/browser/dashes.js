// Of each piece of a slack cable: the offset of its pattern, and its ends.
const pieces = [], pen = CanvasRenderingContext2D.prototype, { stroke, moveTo, lineTo } = pen; let ends = [];
pen.moveTo = function (...at) { ends = [at]; return moveTo.apply(this, at); };
pen.lineTo = function (...at) { ends.push(at); return lineTo.apply(this, at); };
pen.stroke = function () {
  if (this.getLineDash().join() === "1,5") pieces.push([this.lineDashOffset, ...ends]);
  return stroke.call(this);
};
const turn = document.getElementById("turn");
turn.value = 30;
turn.dispatchEvent(new Event("input"));
return pieces;
