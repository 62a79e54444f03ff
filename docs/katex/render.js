// Equations: pymdownx.arithmatex writes \(...\) and \[...\] into elements of this class.
document.querySelectorAll(".arithmatex").forEach((element) => {
  const source = element.textContent.trim();
  katex.render(source.slice(2, -2), element, { displayMode: source.startsWith("\\["), throwOnError: false });
});

// What is wider than a narrow window scrolls: the keyboard must reach it.
function makeScrollable() {
  document.querySelectorAll(".arithmatex, .md-typeset__scrollwrap").forEach((element) => {
    if (element.scrollWidth > element.clientWidth) element.tabIndex = 0;
    else element.removeAttribute("tabindex");
  });
}
window.addEventListener("load", () => setTimeout(makeScrollable, 100));
window.addEventListener("resize", makeScrollable);
