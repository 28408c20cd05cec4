% The declared questions in plain Prolog over the store of SWI-Prolog, timed in one process with all files loaded.
% swipl in_prolog.pl MAP FILE... prints for each question its name, its median time [s] and the number of its answers.

:- use_module(library(semweb/rdf_db)).
:- use_module(library(semweb/turtle)).
:- rdf_register_prefix(knowrob, 'http://knowrob.org/kb/knowrob.owl#').
:- rdf_meta asked(?, ?, t), thing(r, -), individual_of_class(r, ?, ?), above(r, ?), below(r, ?).

% -- classes: unions, intersections and equivalent classes --------------------------------------------------------------

named(X) :- atom(X), \+ rdf_is_bnode(X).

list_item(List, Item) :- rdf(List, rdf:first, Item).
list_item(List, Item) :- rdf(List, rdf:rest, Rest), list_item(Rest, Item).

list_with(Item, List) :- rdf(Cell, rdf:first, Item), list_start(Cell, List).
list_start(List, List).
list_start(Cell, List) :- rdf(Before, rdf:rest, Cell), list_start(Before, List).

equal(A, B) :- rdf(A, owl:equivalentClass, B).
equal(A, B) :- rdf(B, owl:equivalentClass, A).

% said(Class, X): X is a superclass of the class, asserted directly; sayer(X, Class) is the inverse.
said(Class, X) :- ( rdf(Class, rdfs:subClassOf, Y) ; equal(Class, Y) ), within(Y, X).
within(X, X).
within(Y, X) :- rdf_is_bnode(Y), rdf(Y, owl:intersectionOf, List), list_item(List, Z), within(Z, X).

sayer(X, Class) :- around(X, Y), ( rdf(Class, rdfs:subClassOf, Y) ; equal(Y, Class) ), named(Class).
around(X, X).
around(X, Y) :- list_with(X, List), rdf(Z, owl:intersectionOf, List), rdf_is_bnode(Z), around(Z, Y).

up(A, B) :- said(A, B), named(B).
up(A, B) :- list_with(A, List), rdf(X, owl:unionOf, List), ( X = B ; equal(X, B) ; rdf(X, rdfs:subClassOf, B) ), named(B).

down(B, A) :- sayer(B, A).
down(B, A) :- ( X = B ; equal(B, X) ; rdf(X, rdfs:subClassOf, B) ), rdf(X, owl:unionOf, List), list_item(List, A), named(A).

:- meta_predicate closure(2, +, -).
closure(Step, Start, All) :- closure([Start], Step, [Start], All).
closure([], _, Seen, Seen).
closure([X|Rest], Step, Seen, All) :-
    findall(Y, ( call(Step, X, Y), \+ memberchk(Y, Seen) ), Found), sort(Found, New),
    append(Rest, New, Waiting), append(Seen, New, Known), closure(Waiting, Step, Known, All).

above(Class, Above) :- closure(up, Class, All), member(Above, All).
below(Class, Below) :- closure(down, Class, All), member(Below, All).

promise(R, Filler) :- rdf(R, owl:someValuesFrom, Filler).
promise(R, Filler) :-
    ( rdf(R, owl:minQualifiedCardinality, N) ; rdf(R, owl:qualifiedCardinality, N) ),
    N = literal(type(_, Text)), Text \== '0', rdf(R, owl:onClass, Filler).

covers(Filler, Above) :- named(Filler), memberchk(Filler, Above).
covers(Filler, Above) :- rdf_is_bnode(Filler), rdf(Filler, owl:unionOf, List), list_item(List, X), covers(X, Above).
covers(Filler, Above) :-
    rdf_is_bnode(Filler), rdf(Filler, owl:intersectionOf, List), forall(list_item(List, X), covers(X, Above)).

mentioned(Filler, Filler) :- named(Filler).
mentioned(Filler, Class) :-
    rdf_is_bnode(Filler), ( rdf(Filler, owl:unionOf, List) ; rdf(Filler, owl:intersectionOf, List) ),
    list_item(List, X), mentioned(X, Class).

% -- questions ----------------------------------------------------------------------------------------------------------

everything_in_map(Map, Individual) :-
    rdf(Individual, knowrob:describedInMap, Map), \+ ( rdf(Individual, rdf:type, Class), part_class(Class) ).
part_class(Class) :- rdf_equal(Class, knowrob:'Pose').
part_class(Class) :- rdf_equal(Class, knowrob:'LinearConstraint').
part_class(Class) :- rdf_equal(Class, knowrob:'AngularConstraint').

individual_of_class(Class, Map, Individual) :-
    below(Class, Own), rdf(Individual, rdf:type, Own), rdf(Individual, knowrob:describedInMap, Map).

storage_place(Item, Place) :-
    closure(up, Item, Above),
    rdf_reachable(Word, rdfs:subPropertyOf, knowrob:'typePrimaryFunction-containerFor'),
    rdf(R, owl:onProperty, Word), promise(R, Filler), covers(Filler, Above), sayer(R, Place).
storage_place_here(Item, Map, Individual) :- storage_place(Item, Place), individual_of_class(Place, Map, Individual).

device(Action, Device) :- class_property(Action, Word, _, R), device_word(Word), promise(R, Filler), mentioned(Filler, Device).
device_word(Word) :- rdf_reachable(Word, rdfs:subPropertyOf, knowrob:deviceUsed), !.
device_here(Action, Map, Individual) :- device(Action, Device), individual_of_class(Device, Map, Individual).

class_property(Class, Property, Owner, R) :-
    above(Class, Owner), said(Owner, R), rdf_is_bnode(R), rdf(R, owl:onProperty, Property).

sibling(Class, Sibling, Parent) :- up(Class, Parent), down(Parent, Sibling), Sibling \== Class.

part_word(P) :- rdf_equal(P, knowrob:child).
part_word(P) :- rdf_equal(P, knowrob:parts).
part_word(P) :- rdf_equal(P, knowrob:physicalParts).
part_word(P) :- rdf_equal(P, knowrob:properPhysicalParts).

% A constraint refers to its bodies by the same properties; only handles are searched through it.
joint(X) :- rdf(X, rdf:type, Own), above(Own, Class), rdf_equal(Class, knowrob:'Constraint'), !.
step(Whole, Part) :- part_word(P), rdf_has(Whole, P, Part), atom(Part).
step(Whole, Part) :- rdf_has(Part, knowrob:parent, Whole).
part_step(Whole, Part) :- \+ joint(Whole), part_word(P), rdf_has(Whole, P, Part), atom(Part).
part_step(Whole, Part) :- rdf_has(Part, knowrob:parent, Whole), \+ joint(Part).
whole_step(Part, Whole) :- part_word(P), rdf_has(Whole, P, Part), \+ joint(Whole).
whole_step(Part, Whole) :- \+ joint(Part), rdf_has(Part, knowrob:parent, Whole).

part(Whole, Part) :- closure(part_step, Whole, [_|Parts]), member(Part, Parts).
whole(Part, Whole) :- closure(whole_step, Part, [_|Wholes]), member(Whole, Wholes).
handle_of(Thing, Handle) :-
    closure(step, Thing, [_|Parts]), member(Handle, Parts),
    rdf(Handle, rdf:type, Own), above(Own, Class), rdf_equal(Class, knowrob:'Handle').

% -- timed goals --------------------------------------------------------------------------------------------------------

:- dynamic map/1.
thing(Class, Thing) :- map(Map), rdf(Thing, rdf:type, Class), rdf(Thing, knowrob:describedInMap, Map), !.

asked(maps, M, rdf(M, rdf:type, knowrob:'SemanticEnvironmentMap')).
asked(everything_in_map, I, everything_in_map(Map, I)) :- map(Map).
asked(individual_of_class, I, individual_of_class(knowrob:'Handle', Map, I)) :- map(Map).
asked('individual_of_class, any map', I-M, individual_of_class(knowrob:'Handle', M, I)).
asked(part_of, P, part(Thing, P)) :- thing(knowrob:'IAIFridgeDoor', Thing).
asked('part_of, wholes', W, whole(Thing, W)) :- thing(knowrob:'IAIFridgeDoor', Door), once(part(Door, Thing)).
asked(handle_of, H, handle_of(Thing, H)) :- thing(knowrob:'IAIOvenCase', Thing).
asked(subclass_of, C, above(knowrob:'Refrigerator', C)).
asked('subclass_of, below', C, below(knowrob:'StorageConstruct', C)).
asked(siblings, C-P, sibling(knowrob:'Refrigerator', C, P)).
asked(class_properties, P-O-R, class_property(knowrob:'Refrigerator', P, O, R)).
asked(storage_place, P, storage_place(knowrob:'CowsMilk', P)).
asked(storage_place_in_environment, I, storage_place_here(knowrob:'CowsMilk', Map, I)) :- map(Map).
asked(device_for_action, D, device(knowrob:'BakingFood', D)).
asked(device_for_action_in_environment, I, device_here(knowrob:'BakingFood', Map, I)) :- map(Map).

seconds(Goal, Seconds) :- numlist(1, 9, Runs), findall(S, ( member(_, Runs), sample(Goal, S) ), All), msort(All, Sorted), nth1(5, Sorted, Seconds).
sample(Goal, Seconds) :- get_time(Start), sample(Goal, 0, Start, Seconds).
sample(Goal, Count, Start, Seconds) :-
    findall(x, Goal, _), Done is Count + 1, get_time(Now), Spent is Now - Start,
    ( Spent > 0.01 -> Seconds is Spent / Done ; sample(Goal, Done, Start, Seconds) ).

load(Path) :- file_name_extension(_, ttl, Path), !, rdf_load(Path, [format(turtle), silent(true)]).
load(Path) :- rdf_load(Path, [format(xml), silent(true)]).

main :-
    current_prolog_flag(argv, [Map|Files]), assertz(map(Map)),
    get_time(Start), forall(member(File, Files), load(File)), get_time(End), Load is End - Start,
    rdf_statistics(triples(Triples)), format("load\t~w\t~w~n", [Load, Triples]),
    forall(( Map \== (-), clause(asked(Name, Answer, Goal), Body) ),
           ( call(Body), findall(Answer, Goal, _), seconds(Goal, Seconds),
             findall(Answer, Goal, All), sort(All, Set), length(Set, Count),
             format("~w\t~w\t~w~n", [Name, Seconds, Count]) )).

:- initialization((catch(main, E, (print_message(error, E), halt(2))), halt(0)), main).
