// @ts-check
// Elements of the page.

/**
 * The element of an id, of whatever kind it is in the page.
 * @param {string} id
 * @returns {any}
 */
export function byId(id) {
  return document.getElementById(id);
}

/**
 * What is focused: its value in `data-…`, to find it again after a list was made anew.
 * @param {string} name
 * @returns {string | undefined}
 */
export function focusedIn(name) {
  const { activeElement } = document;
  return activeElement instanceof HTMLElement ? activeElement.dataset[name] : undefined;
}

/**
 * A new element with these properties and children.
 * @param {string} tag
 * @param {object} properties
 * @param {...(Node | string)} children
 * @returns {any}
 */
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

/**
 * Whether an element takes room on the page: it is not hidden, nor is what it lies in.
 * @param {Element} node
 */
export function isVisible(node) {
  return node.getClientRects().length > 0;
}
