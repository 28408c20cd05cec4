% Who may examine a thesis: facts, and rules that only Prolog's own resolution puts in order.
% It stands for the thesis's introduction to Prolog, whose text we do not have: a user's own file, consulted, whose
% solutions come in the order of its clauses.

professor(ada).
professor(berta).
professor(carl).

works_at(ada, robotics).
works_at(berta, graphics).
works_at(carl, robotics).
works_at(dora, robotics).
works_at(emil, graphics).

supervises(ada, dora).
supervises(berta, emil).

% Two work together where they are at the same institute, or where one supervises the other.
work_together(One, Other) :- works_at(One, Institute), works_at(Other, Institute), One \== Other.
work_together(One, Other) :- supervises(One, Other).

% First whoever supervises, then every other professor who does not work together with the author.
examiner(Author, Professor) :- supervises(Professor, Author), professor(Professor).
examiner(Author, Professor) :- professor(Professor), \+ work_together(Professor, Author).

% Rules may speak of the robot's kitchen, too: professors are trusted with the fridge.
may_open(Person, Handle) :- professor(Person), handle_of(_, kitchen:fridge_door, Handle).
