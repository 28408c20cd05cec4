% The same rules as Mindstage's reasoner and questions, in plain Prolog over SWI-Prolog's own store.
% Prints one answer per line; run as: swipl oracle.pl FILE...

:- use_module(library(semweb/rdf11)).
:- use_module(library(semweb/turtle)).
:- rdf_register_prefix(knowrob, 'http://knowrob.org/kb/knowrob.owl#').
:- rdf_register_prefix(dul, 'http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#').
:- rdf_meta told(r, r, o), sub_property(r, r), kind_of(r, r), part_property(r), whole_property(r).
:- dynamic up/2.  % every edge, asserted once after loading
:- table sub_class/2, sub_property/2, part/2, tight_part/2, restricted/3, storage_place/2, device_for_action/2.

told(S, P, O) :- rdf(S, P, O).

named(X) :- atom(X), \+ rdf_is_bnode(X).

list_item(List, Item) :- told(List, rdf:first, Item).
list_item(List, Item) :- told(List, rdf:rest, Rest), list_item(Rest, Item).

equal(A, B) :- told(A, owl:equivalentClass, B).
equal(A, B) :- told(B, owl:equivalentClass, A).

% superclass_expression(Class, Expression): every member of the class is an instance of the expression.
superclass_expression(Class, X) :- told(Class, rdfs:subClassOf, Y), named(Class), within(Y, X).
superclass_expression(Class, X) :- equal(Class, Y), named(Class), within(Y, X).
superclass_expression(Class, X) :- told(Class, owl:intersectionOf, List), named(Class), list_item(List, Y), within(Y, X).

within(X, X).
within(Y, X) :- \+ named(Y), told(Y, owl:intersectionOf, List), list_item(List, Z), within(Z, X).

% subsumed(Expression, Class): the named classes that the expression subsumes.
subsumed(Class, Class) :- named(Class).
subsumed(X, Class) :- \+ named(X), told(X, owl:unionOf, List), list_item(List, Y), subsumed(Y, Class).

edge(A, B) :- superclass_expression(A, B), named(B).
edge(A, B) :- told(X, rdfs:subClassOf, B), named(B), subsumed(X, A).
edge(A, B) :- equal(X, B), named(B), subsumed(X, A).
edge(A, B) :- told(B, owl:unionOf, List), named(B), list_item(List, X), subsumed(X, A).

sub_class(A, B) :- up(A, B).
sub_class(A, B) :- sub_class(A, C), up(C, B).

is_a(A, A).
is_a(A, B) :- sub_class(A, B).

sub_property(P, P).
sub_property(P, Q) :- sub_property(P, R), told(R, rdfs:subPropertyOf, Q).
sub_property(P, Q) :- sub_property(P, R), told(R, owl:equivalentProperty, Q).
sub_property(P, Q) :- sub_property(P, R), told(Q, owl:equivalentProperty, R).

% needs(Class, Property, Filler): each member has such a value; implied properties count.
needs(Class, Property, Filler) :-
    superclass_expression(Class, R), told(R, owl:onProperty, P), named(P), promised(R, Filler),
    sub_property(P, Property).

promised(R, Filler) :- told(R, owl:someValuesFrom, Filler).
promised(R, Filler) :-
    ( told(R, owl:minQualifiedCardinality, N^^_) ; told(R, owl:qualifiedCardinality, N^^_) ),
    N > 0, told(R, owl:onClass, Filler).

covers(Filler, Item) :- named(Filler), is_a(Item, Filler).
covers(Filler, Item) :- told(Filler, owl:unionOf, List), list_item(List, X), covers(X, Item).
covers(Filler, Item) :-
    told(Filler, owl:intersectionOf, List), forall(list_item(List, X), covers(X, Item)).

mentioned(Filler, Filler) :- named(Filler).
mentioned(Filler, Class) :-
    ( told(Filler, owl:unionOf, List) ; told(Filler, owl:intersectionOf, List) ),
    list_item(List, X), mentioned(X, Class).

class(C) :- up(C, _).
class(C) :- up(_, C).
class(C) :- superclass_expression(_, R), promised(R, F), mentioned(F, C).

storage_place(Item, Place) :-
    rdf_equal(knowrob:'typePrimaryFunction-containerFor', For),
    setof(C, class(C), Classes), setof(P-F, needs(P, For, F), Needs),
    member(Place-Filler, Needs), member(Item, Classes), covers(Filler, Item).

device_for_action(Action, Device) :-
    rdf_equal(knowrob:deviceUsed, Used),
    needs(Owner, Used, Filler), mentioned(Filler, Device), ( Action = Owner ; sub_class(Action, Owner) ).

kind_of(Individual, Class) :- told(Individual, rdf:type, Own), is_a(Own, Class).

here(Individual, Map) :- told(Individual, knowrob:describedInMap, Map).

storage_place_in_environment(Item, Individual) :-
    storage_place(Item, Place), here(Individual, _), kind_of(Individual, Place).
device_for_action_in_environment(Action, Individual) :-
    device_for_action(Action, Device), here(Individual, _), kind_of(Individual, Device).

part_property(P) :- rdf_equal(knowrob:child, Q), sub_property(P, Q).
part_property(P) :- rdf_equal(knowrob:parts, Q), sub_property(P, Q).
part_property(P) :- rdf_equal(knowrob:physicalParts, Q), sub_property(P, Q).
part_property(P) :- rdf_equal(knowrob:properPhysicalParts, Q), sub_property(P, Q).
whole_property(P) :- rdf_equal(knowrob:parent, Q), sub_property(P, Q).

step(Whole, Part) :- part_property(P), told(Whole, P, Part).
step(Whole, Part) :- whole_property(P), told(Part, P, Whole).
part(Whole, Part) :- step(Whole, Part).
part(Whole, Part) :- part(Whole, Between), step(Between, Part).

handle_of(Whole, Handle) :-
    part(Whole, Handle), Whole \== Handle, here(Whole, _),
    \+ kind_of(Whole, knowrob:'Constraint'), kind_of(Handle, knowrob:'Handle').

individual_of_class(Class, Individual) :-
    here(Individual, _), told(Individual, rdf:type, Own),
    \+ sub_atom(Own, 0, _, _, 'http://www.w3.org/'), is_a(Own, Class).

% A joint uses the part-of properties for the two bodies that it connects, which makes neither a part of the other.
tight_step(Whole, Part) :- part_property(P), told(Whole, P, Part), \+ kind_of(Whole, knowrob:'Constraint').
tight_step(Whole, Part) :- whole_property(P), told(Part, P, Whole), \+ kind_of(Part, knowrob:'Constraint').
tight_part(Whole, Part) :- tight_step(Whole, Part).
tight_part(Whole, Part) :- tight_part(Whole, Between), tight_step(Between, Part).

part_of(Part, Whole) :- tight_part(Whole, Part), Part \== Whole, here(Whole, _).

% The restrictions of a class: the property, the class that has it, the OWL term, and the filler if it is named.
class_properties(Class, Told) :-
    setof(C, class_or_sayer(C), Classes), member(Class, Classes), is_a(Class, Owner),
    restricted(Owner, R, Property), word(R, Kind, Value),
    format(atom(Told), "~w ~w ~w ~w", [Property, Owner, Kind, Value]).
class_or_sayer(C) :- up(C, _).
class_or_sayer(C) :- restricted(C, _, _).
restricted(Class, R, Property) :- superclass_expression(Class, R), told(R, owl:onProperty, P), line(P, Property).
line(P, P) :- named(P).
line(P, Inverse) :- \+ named(P), told(P, owl:inverseOf, Q), named(Q), atom_concat(^, Q, Inverse).

word(R, Kind, Value) :-
    ( filler(Word, Kind), told(R, Word, V) -> value(V, Value)
    ; count(Word, Kind), told(R, Word, _) -> ( qualifier(Q), told(R, Q, V) -> value(V, Value) ; Value = '-' )
    ; told(R, owl:hasSelf, _), Kind = hasSelf, Value = '-' ).
value(V, V) :- named(V), !.

value(_, '-').
:- rdf_meta filler(r, -), count(r, -), qualifier(r).
filler(owl:someValuesFrom, someValuesFrom).
filler(owl:allValuesFrom, allValuesFrom).
filler(owl:hasValue, hasValue).
count(owl:minCardinality, minCardinality).
count(owl:maxCardinality, maxCardinality).
count(owl:cardinality, cardinality).
count(owl:minQualifiedCardinality, minCardinality).
count(owl:maxQualifiedCardinality, maxCardinality).
count(owl:qualifiedCardinality, cardinality).
qualifier(owl:onClass).
qualifier(owl:onDataRange).

% What is directly below an equivalent class is directly below the class itself.
siblings(A, B) :-
    below_another(A), same(A, A1), up(A1, Parent), \+ same(A, Parent),
    up(B1, Parent), same(B1, B), \+ same(B, Parent), \+ same(A, B).

:- table same/2, below_another/1.
below_another(A) :- up(A, _).
same(A, A).
same(A, B) :- sub_class(A, B), A \== B, once(sub_class(B, A)).

subclass_of(A, B) :- sub_class(A, B), A \== B.

question(subclass_of). question(storage_place). question(storage_place_in_environment).
question(device_for_action). question(device_for_action_in_environment).
question(handle_of). question(individual_of_class).
question(part_of). question(class_properties). question(siblings).

main :-
    current_prolog_flag(argv, Files),
    forall(member(File, Files), rdf_load(File, [silent(true)])),
    forall(edge(A, B), assertz(up(A, B))),
    forall(( question(Q), Goal =.. [Q, X, Y], setof(X-Y, Goal, Pairs), member(X-Y, Pairs) ),
           format("~w\t~w\t~w~n", [Q, X, Y])).

:- initialization((catch(main, E, (print_message(error, E), halt(2))), halt(0)), main).
