// @ts-check
// One format of time everywhere: date and time of day, as 2026-05-01 12:07:12.

/**
 * A moment, ISO 8601 or milliseconds since 1970, by this device's clock; one without a zone as it is written.
 * @param {string | number} moment
 */
export function written(moment) {
  const then = new Date(moment);
  const two = (value) => String(value).padStart(2, "0");
  const date = [then.getFullYear(), two(then.getMonth() + 1), two(then.getDate())].join("-");
  return `${date} ${[then.getHours(), then.getMinutes(), then.getSeconds()].map(two).join(":")}`;
}
