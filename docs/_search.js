// How the search sorts: Sphinx's own weights, and what a user does first comes before what was measured.
var Scorer = {
  score: ([docname, , , , score]) => score + (/^(guides|start)/.test(docname) ? 20 : /^(environments|studies\/\w+$)/.test(docname) ? 5 : 0),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
