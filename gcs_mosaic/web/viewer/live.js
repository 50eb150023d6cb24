// @ts-check
// Listening for changes, for ever: a browser by itself gives up for good when the server refuses once.

const FIRST_RETRY_MS = 1000;
const LONGEST_RETRY_MS = 10000;

export class Live {
  static restsAfterMs = 20000; // hidden: a browser has six connections for all tabs of a server, which each keeps one of
  isOpen = false;
  isResting = false;
  hasEnded = false; // the server has said farewell, and has not come back

  /**
   * `onNotes`: somebody has added something; `onEnded`: the server says farewell; what it has can be read for two more seconds.
   * `onSign`: the server is there: whatever has come, and each two seconds where there is nothing else to tell.
   * @param {(change: Api.Change) => void} onChange
   * @param {() => void} onEnded
   * @param {() => void} onNotes
   * @param {() => void} onSign
   */
  constructor(onChange, onEnded, onNotes, onSign) {
    this.onChange = onChange;
    this.onEnded = onEnded;
    this.onNotes = onNotes;
    this.onSign = onSign;
    this.retryMs = FIRST_RETRY_MS;
    this.resting = 0;
    document.addEventListener("visibilitychange", () => this.followSight());
    this.listen();
  }

  /** A page that nobody sees lets go of its connection, and asks what is new when it is seen again. */
  followSight() {
    clearTimeout(this.resting);
    if (document.hidden) this.resting = setTimeout(() => this.rest(), Live.restsAfterMs);
    else if (this.isResting) {
      this.isResting = false;
      this.listen();
    }
  }

  rest() {
    this.isResting = true;
    this.isOpen = false;
    this.source.close();
  }

  listen() {
    this.source = new EventSource("/live");
    this.source.onopen = () => Object.assign(this, { isOpen: true, hasEnded: false, retryMs: FIRST_RETRY_MS });
    this.source.onmessage = (message) => this.onChange(JSON.parse(message.data));
    this.source.addEventListener("notes", () => this.onNotes?.());
    for (const sign of ["open", "message", "notes", "alive"]) this.source.addEventListener(sign, () => this.onSign());
    this.source.addEventListener("ended", () => this.end());
    this.source.onerror = () => {
      this.isOpen = false;
      if (this.source.readyState === EventSource.CLOSED) this.listenLater(); // else the browser tries again
    };
  }

  end() {
    this.source.close();
    this.isOpen = false;
    this.hasEnded = true;
    this.onEnded();
    this.listenLater(); // for whoever serves the flight next
  }

  listenLater() {
    setTimeout(() => this.isResting || this.listen(), this.retryMs);
    this.retryMs = Math.min(2 * this.retryMs, LONGEST_RETRY_MS);
  }

  /** Begin anew, where a connection is open that brings nothing: the network may have changed under it. */
  restart() {
    this.source.close();
    this.isOpen = false;
    this.listen();
  }
}

/** For how long a revision that the status tells of has not been shown. */
export class Lag {
  wanted = null; // the revision that is waited for, and since when

  /** Seconds; 0 while what is shown is new enough. */
  seconds(shown, told) {
    const isSettled = !this.wanted || shown >= this.wanted.revision || told < this.wanted.revision;
    if (isSettled) this.wanted = told > shown ? { revision: told, since: Date.now() } : null;
    return this.wanted ? (Date.now() - this.wanted.since) / 1000 : 0;
  }
}
