// How the search sorts: Sphinx's own weights, what a user does before what was measured, and pages with the word in their title first.
const asked = ` ${new URLSearchParams(location.search).get("q") ?? ""} `.toLowerCase();
var Scorer = {
  score: ([docname, title, , , score]) =>
    score +
    (/^(guides|start)/.test(docname) ? 20 : /^(environments|studies\/\w+$)/.test(docname) ? 5 : 0) +
    (!docname.startsWith("reference") && ` ${title.toLowerCase().replace(/\W+/g, " ")} `.includes(asked) ? 20 : 0),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
