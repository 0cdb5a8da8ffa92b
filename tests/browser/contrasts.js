// Of each element with words of its own: its tag, its words, their contrast and their size [pixel].
const pen = Object.assign(document.createElement("canvas"), {width: 1, height: 1}).getContext("2d");
const bytes = (color) => {
  pen.clearRect(0, 0, 1, 1);
  pen.fillStyle = color;
  pen.fillRect(0, 0, 1, 1);
  return [...pen.getImageData(0, 0, 1, 1).data];
};
const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
const behind = (one) => {
  for (; one; one = one.parentElement) {
    const color = bytes(getComputedStyle(one).backgroundColor);
    if (color[3] === 255) return color;
  }
  return [255, 255, 255];
};
const speaks = (one) => one.checkVisibility() && !one.closest("noscript, select")
  && [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
return [...document.querySelectorAll("body *")].filter(speaks).map((one) => {
  const look = getComputedStyle(one), paper = behind(one);
  const ink = bytes(look.color).map((v, i) => +look.opacity * v + (1 - look.opacity) * paper[i]);
  const [a, b] = [light(ink), light(paper)].sort((x, y) => y - x);
  return [one.tagName, one.textContent.slice(0, 40), (a + 0.05) / (b + 0.05), parseFloat(look.fontSize)];
});
