// @ts-check
// Printed, the page is as on the screen, as large as it fits on the sheet: no part of the map is cut off.

const SHEET = { width: 970, height: 690 }; // CSS px of A4 and of Letter, lying, less the margins

export function fitOnPaper() {
  const style = document.documentElement.style;
  addEventListener("beforeprint", () => {
    style.setProperty("--screen-width", `${innerWidth}px`);
    style.setProperty("--screen-height", `${innerHeight}px`);
    style.setProperty("--on-paper", String(Math.min(1, SHEET.width / innerWidth, SHEET.height / innerHeight)));
  });
}
