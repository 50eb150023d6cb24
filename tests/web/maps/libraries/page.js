// A page of another site that shows the flight: it asks TileJSON for the revision, and for the tiles again whenever that changes.
// Each library's script beside it defines `begin(url, [longitude, latitude], told)`, which returns what is called with a new URL.

const asked = new URLSearchParams(location.search);
const place = [Number(asked.get("longitude")), Number(asked.get("latitude"))];
window.shownRevision = null;
let refresh = null;

async function look() {
  const told = await (await fetch(asked.get("tilejson"), { cache: "no-store" })).json();
  const [tiles] = told.tiles;
  const url = `${tiles}${tiles.includes("?") ? "&" : "?"}r=${told.revision}`;
  if (told.revision !== window.shownRevision) {
    if (refresh) refresh(url);
    else refresh = await begin(url, place, told);
    window.shownRevision = told.revision;
  }
}

look().then(() => setInterval(look, 1000));
