"""What an inversion decides, in order."""

from agglom_mpi.search.proposals import GenerationSummary, StringEvaluated, StringsProposed


class DecisionLog:
    """Results of strings and summaries of generations; subclasses keep what is proposed."""

    def __init__(self):
        self.results, self.summaries = {}, []

    def record(self, decisions):
        for decision in decisions:
            match decision:
                case StringsProposed(proposals, strings, ahead):
                    (self.proposed_ahead if ahead else self.proposed)(proposals, strings)
                case StringEvaluated(string, result):
                    self.evaluated(string, result)
                case GenerationSummary():
                    self.summaries.append(decision)

    def propose_ahead(self, inversion, generations):
        """Return the numbers of strings of a coming generation; none if there is none."""
        proposed = inversion.propose_ahead(generations)
        if proposed is None:
            return []
        self.record([proposed])
        return proposed.strings.tolist()

    def proposed_ahead(self, batch, ids):
        pass

    def proposed(self, batch, ids):
        pass

    def evaluated(self, string, result):
        assert string not in self.results
        self.results[string] = result
