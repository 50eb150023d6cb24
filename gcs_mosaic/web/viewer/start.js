// @ts-check
// The page begins, or says that it cannot: a script that is lost on the way must not leave it blank. No module, so that it runs
// whatever becomes of those.

(() => {
  const LONGEST_MS = 20000;
  const SAID = {
    en: ["The page could not be loaded whole.", "Reload"],
    de: ["Die Seite konnte nicht ganz geladen werden.", "Neu laden"],
  };

  function fail() {
    if (document.documentElement.dataset.begun || document.getElementById("failed")) return;
    const [sentence, again] = SAID[navigator.language.slice(0, 2)] || SAID.en;
    const box = document.createElement("div");
    const button = document.createElement("button");
    box.id = "failed";
    box.setAttribute("role", "alert");
    button.type = "button";
    button.textContent = again;
    button.onclick = () => location.reload();
    box.append(sentence, " ", button);
    document.body.append(box);
    document.documentElement.dataset.failed = "1";
  }

  // A script that does not come, and one that breaks, before the page has begun.
  addEventListener("error", ({ target }) => (target === window || target instanceof HTMLScriptElement) && whenThere(fail), true);
  addEventListener("unhandledrejection", () => whenThere(fail));
  setTimeout(fail, LONGEST_MS);

  function whenThere(action) {
    if (document.body) action();
    else addEventListener("DOMContentLoaded", action);
  }
})();
