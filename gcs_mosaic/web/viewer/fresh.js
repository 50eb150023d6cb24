// @ts-check
// Answers that are made of the frames on the map: asked for again as long as they are older than the map that is shown.

const SOON_MS = 300; // until what the server does not know yet is asked for again
const LONGEST_MS = 5000; // where it comes to know nothing new
const OLD_MS = 3000; // then it is said that what is shown is old

export class Fresh {
  /**
   * `ask()`: ask, and show what comes; the map's revision that it is of, null where nothing came. `onOld`: told whether what is
   * shown is older than the map, and has been for some seconds.
   * @param {() => Promise<number | null>} ask
   * @param {(isOld: boolean) => void} [onOld]
   */
  constructor(ask, onOld = () => {}) {
    this.ask = ask;
    this.onOld = onOld;
    this.isAsking = false;
    this.timer = 0;
    this.wanted = -1;
    this.begin();
  }

  /** Nothing is known: something else is asked for from now on. */
  begin() {
    this.answered = -1;
    this.wait = SOON_MS;
    this.oldSince = 0;
  }

  /** The map is at this revision. */
  follow(revision) {
    this.wanted = Math.max(this.wanted, revision);
    this.tellOld();
    if (this.answered < this.wanted && !this.isAsking && !this.timer) this.again();
  }

  tellOld() {
    const isBehind = this.answered < this.wanted;
    this.oldSince = isBehind ? this.oldSince || Date.now() : 0;
    this.onOld(isBehind && Date.now() - this.oldSince > OLD_MS);
  }

  /** Ask now: also when the map is as it was. */
  async again() {
    if (this.isAsking) {
      this.isWantedAgain = true;
      return;
    }
    clearTimeout(this.timer);
    this.timer = 0;
    this.isAsking = true;
    const answered = await this.ask().catch(() => null); // what is shown stays
    this.isAsking = false;
    this.wait = answered !== null && answered > this.answered ? SOON_MS : Math.min(2 * this.wait, LONGEST_MS);
    this.answered = answered ?? this.answered;
    this.tellOld();
    if (this.isWantedAgain || this.answered < this.wanted) this.timer = window.setTimeout(() => this.again(), this.isWantedAgain ? 0 : this.wait);
    this.isWantedAgain = false;
  }
}
