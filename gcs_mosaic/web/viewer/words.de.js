// German.

export default {
  "Close": "Schließen",
  "Follow newest": "Neuestem folgen",
  "Full screen": "Vollbild",
  "Layers": "Ebenen",
  "Look": "Aussehen",
  "Whole map": "Ganze Karte",
};
