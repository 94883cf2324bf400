// How the search of these pages orders what it finds: guides stand before the reference of Python.
const REFERENCE = 40;
const ANSWERS = 20;
const FIRST = ["faq", "glossary", "which_learner"];

var Scorer = {
  score: ([name, , , , points]) => {
    if (name.startsWith("generated/api")) return points - REFERENCE;
    if (FIRST.includes(name)) return points + ANSWERS;
    return points;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
