from dataclasses import dataclass
import numpy as np
from slamcli.rtabmap.dictionary import Dictionary
@dataclass
class Added:
    merged_id: int | None = None
@dataclass
class Sizes:
    short_term: int; working: int; long_term: int; words: int
class Memory:
    bounded = False
    def __init__(self, parameters):
        self.p = parameters
        self.dictionary = Dictionary()
        self.all = {}
    @property
    def short_term(self): return sorted(self.all)[-10:]
    @property
    def working(self): return sorted(self.all)[:-10]
    def words_of(self, features):
        out = np.zeros(len(features), dtype=np.int64)
        n = min(len(features), self.p.kp.max_features if self.p.kp.max_features > 0 else 0)
        out[:n] = self.dictionary.quantise(np.ascontiguousarray(features.descriptors[:n])) if n else 0
        return out
    def rehearse(self, s): pass
    def add(self, s):
        self.all[s.id] = s
        return Added()
    def signature(self, i): return self.all.get(i)
    recall = signature
    def retrieve(self, node, graph): return []
    def transfer(self, keep, graph): return []
    def take_changed_weights(self): return []
    def sizes(self): return Sizes(len(self.short_term), len(self.working), 0, len(self.dictionary))
