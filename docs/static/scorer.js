// How the search of these pages orders what it finds: answers first, the reference of Python last.
const MORE = { installation: 30, commands: 14, learners: 14, environments: 10, glossary: 7 };
const REFERENCE = 40;

var Scorer = {
  score: ([name, , , , points]) => {
    if (name.startsWith("generated/api")) return points - REFERENCE;
    return points + (MORE[name] ?? 0);
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
