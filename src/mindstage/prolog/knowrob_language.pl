% The predicates of KnowRob 2's query language, openEASE's descriptions of entities, and markers; and the predicates of
% KnowRob that are not part of Mindstage, each of which throws an error that says why.

:- module(mindstage_knowrob_language,
          [ ask/1, tell/1, forget/1, kb_call/1, kb_project/1, kb_unproject/1,
            triple/3, has_type/2, instance_of/2, subclass_of/2, is_a/2, is_individual/1, is_class/1, new_iri/2,
            is_at/2, has_part/2, is_inside_of/2, is_supported_by/2,
            entity/2, show/1, show/2,
            kb_triple/3, kb_type_of/2, kb_create/2, kb_create/3, kb_assert/3, kb_assert/4, kb_retract/3, kb_retract/4,
            during/2, since/2, until/2,
            op(995, xfx, user:during), op(995, xfx, user:since), op(995, xfx, user:until),
            marker/2, marker_pose/2, marker_scale/2, marker_color/2, marker_remove/1,
            knowrob_not_here/2 ]).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(knowrob_objects).
:- use_module(episodes).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(solution_sequences)).

:- meta_predicate during(:, ?), since(:, ?), until(:, ?).
:- meta_predicate ask(:), tell(:), forget(:), kb_call(:), kb_project(:), kb_unproject(:).

% -- asking and telling --------------------------------------------------------------------------------------------------

%!  ask(:Statement) is nondet.
%!  kb_call(:Statement) is nondet.
%
%   A goal or a list of goals; a goal without variables has one solution.
ask(Statement) :- kb_call(Statement).
kb_call(Module:Statement) :-
    goal(Statement, Goal),
    must_be(callable, Goal),
    (   ground(Goal) -> once(Module:Goal) ; Module:Goal ).

goal(Statement, Goal) :- is_list(Statement), !, ( Statement == [] -> Goal = true ; comma_list(Goal, Statement) ).
goal(Goal, Goal).

%!  tell(:Statement) is det.
%!  kb_project(:Statement) is det.
%
%   Asserts a statement, a conjunction or a list of them. is_at/2 moves the body in the running simulation.
tell(Statement) :- kb_project(Statement).
kb_project(Module:Statement) :-
    goal(Statement, Goal),
    must_be(callable, Goal),
    project(Goal, Module).

project((A, B), Module) :- !, project(A, Module), project(B, Module).
project(Goal, _) :- statement_triple(Goal, triple(Subject, Property, Value)), !,
    maplist(require_bound(Goal), [Subject, Property, Value]),
    maplist(known_name, [Subject, Property, Value], [One, Relation, Other]),
    asserted_value(Other, Asserted),
    mindstage:rdf_assert(One, Relation, Asserted).
project(is_at(Object, [Frame, Position, [X, Y, Z, W]]), _) :- !,
    (   Frame == map -> true
    ;   throw(mindstage_error('InvalidArgumentError', "a pose that is told must be in the frame map"))
    ),
    expand_prefixes(Object, Given),
    request(move(Given, Position, [W, X, Y, Z]), _).
project(new_iri(Iri, Class), _) :- !, new_iri(Iri, Class).
project(ask(Goal), Module) :- !, once(ask(Module:Goal)).
project(Goal, Module) :- mindstage_user_files:told_by(Goal, Body), !, project(Body, Module).
project(Goal, _) :- refuse_statement(Goal).

% known_name(+Given, -Name): the whole name of a short one that something has; any other term as it is.
known_name(Given, Iri) :-
    atom(Given), \+ sub_atom(Given, _, _, _, :),
    request(name_kinds(Given), [Kind|_]), !,
    arg(1, Kind, Iri).
known_name(Given, Given).

%!  forget(:Statement) is det.
%!  kb_unproject(:Statement) is det.
%
%   Removes the statements that match; unbound parts match everything.
forget(Statement) :- kb_unproject(Statement).
kb_unproject(_:Statement) :-
    goal(Statement, Goal),
    must_be(callable, Goal),
    unproject(Goal).

unproject((A, B)) :- !, unproject(A), unproject(B).
unproject(Goal) :- statement_triple(Goal, triple(Subject, Property, Value)), !,
    ( var(Value) -> Removed = Value ; asserted_value(Value, Removed) ),
    mindstage:rdf_retractall(Subject, Property, Removed).
unproject(Goal) :- refuse_statement(Goal).

require_bound(_, Part) :- nonvar(Part), !.
require_bound(_, Part) :- instantiation_error(Part).

refuse_statement(Goal) :-
    format(string(Sentence), "~p cannot be asserted; there is triple/3, holds/3, has_type/2, instance_of/2, subclass_of/2, \c
is_individual/1, is_class/1, has_part/2, is_at/2 (in the frame map), new_iri/2 and ask/1", [Goal]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).

statement_triple(triple(S, P, O), triple(S, P, O)).
statement_triple(holds(S, P, O), triple(S, P, O)).
statement_triple(has_type(S, C), triple(S, rdf:type, C)).
statement_triple(instance_of(S, C), triple(S, rdf:type, C)).
statement_triple(subclass_of(C, D), triple(C, rdfs:subClassOf, D)).
statement_triple(is_individual(S), triple(S, rdf:type, owl:'NamedIndividual')).
statement_triple(is_class(S), triple(S, rdf:type, owl:'Class')).
statement_triple(has_part(Whole, Part), triple(Whole, dul:hasPart, Part)).

% Numbers and strings are literals, atoms are names.
asserted_value(Value, literal(type(Type, Value))) :- integer(Value), !, expand_prefixes(xsd:integer, Type).
asserted_value(Value, literal(type(Type, Value))) :- float(Value), !, expand_prefixes(xsd:double, Type).
asserted_value(Value, literal(type(Type, Text))) :- string(Value), !,
    atom_string(Text, Value),
    expand_prefixes(xsd:string, Type).
asserted_value(Value, Value).

% new_iri(-Iri, +Class): a name that occurs in no statement.
new_iri(Iri, Class) :-
    expand_prefixes(Class, Given),
    must_be(atom, Given),
    (   var(Iri)
    ->  repeat,
        Number is random(0xffffffff),
        format(atom(Iri), "~w_~|~`0t~16r~8+", [Given, Number]),
        \+ mindstage:rdf(Iri, _, _),
        !
    ;   true
    ).

% -- statements ----------------------------------------------------------------------------------------------------------

%!  triple(?Subject, ?Property, ?Value) is nondet.
%
%   Includes subproperties, inverses and computed properties. Values of literals are numbers and atoms. Property may be
%   transitive(Property), over one or more statements, and reflexive(Property), which holds of a resource and itself too.
triple(Given, Path, Value) :- nonvar(Path), property_path(Path, Stated, Transitive, Reflexive), !,
    full_name(Given, individual, Subject),
    full_name(Value, individual, Object),
    full_name(Stated, property, Property),
    (   Reflexive == true, var(Subject), var(Object)
    ->  instantiation_error(Given)
    ;   true
    ),
    distinct(Subject-Object, path(Transitive, Reflexive, Subject, Property, Object)),
    bind(Given, Subject),
    bind(Value, Object).
triple(Given, Stated, Value) :-
    full_name(Given, individual, Subject),
    full_name(Stated, property, Property),
    stated_triple(Subject, Property, Value),
    bind(Given, Subject),
    bind(Stated, Property).

property_path(transitive(Path), Property, true, Reflexive) :- !,
    ( nonvar(Path), Path = reflexive(Property) -> Reflexive = true ; Property = Path, Reflexive = false ).
property_path(reflexive(Path), Property, Transitive, true) :-
    ( nonvar(Path), Path = transitive(Property) -> Transitive = true ; Property = Path, Transitive = false ).

path(_, true, Subject, _, Object) :- ( var(Subject) -> Subject = Object ; Object = Subject ).
path(false, _, Subject, Property, Object) :- mindstage:rdf_has(Subject, Property, Object), atom(Object).
path(true, _, Subject, Property, Object) :-
    (   nonvar(Subject) -> reached([Subject], forward, Property, [], Found), member(Object, Found)
    ;   nonvar(Object) -> reached([Object], backward, Property, [], Found), member(Subject, Found)
    ;   distinct(Subject, ( mindstage:rdf_has(Subject, Property, First), atom(First) )),
        reached([Subject], forward, Property, [], Found), member(Object, Found)
    ).

% reached(+Queue, +Direction, +Property, +Seen, -Found): what follows the resources of the queue over one or more statements.
reached([], _, _, Seen, Found) :- reverse(Seen, Found).
reached([From|Queue], Direction, Property, Seen, Found) :-
    findall(To, next(Direction, From, Property, To), Nexts),
    sort(Nexts, Sorted),
    subtract(Sorted, Seen, New),
    append(Queue, New, Longer),
    reverse(New, Latest),
    append(Latest, Seen, All),
    reached(Longer, Direction, Property, All, Found).

next(forward, From, Property, To) :- mindstage:rdf_has(From, Property, To), atom(To).
next(backward, From, Property, To) :- mindstage:rdf_has(To, Property, From).

stated_triple(Subject, Property, Value) :-
    (   var(Value) -> Pattern = Value
    ;   plain(Value, Plain) -> Pattern = literal(_), Compared = Plain
    ;   Pattern = Value
    ),
    (   nonvar(Compared)
    ->  mindstage:rdf_has(Subject, Property, Pattern),
        literal_value(Pattern, Found),
        ( number(Compared), number(Found) -> Found =:= Compared ; Found == Compared )
    ;   var(Pattern)
    ->  mindstage:rdf_has(Subject, Property, Found),
        literal_value(Found, Value)
    ;   atom(Value), \+ sub_atom(Value, _, _, _, :)
    ->  (   request(name_kinds(Value), Kinds), member(Kind, Kinds), arg(1, Kind, Resource),
            mindstage:rdf_has(Subject, Property, Resource)
        ;   mindstage:rdf_has(Subject, Property, literal(Literal)),
            literal_value(literal(Literal), Value)
        )
    ;   mindstage:rdf_has(Subject, Property, Pattern)
    ).

plain(Value, Value) :- number(Value).
plain(Value, Atom) :- string(Value), atom_string(Atom, Value).

literal_value(literal(Literal), Value) :- !,
    (   Literal = type(Type, Text) -> typed_value(Type, Text, Value)
    ;   Literal = lang(_, Text) -> Value = Text
    ;   Value = Literal
    ).
literal_value(Value, Value).

typed_value(Type, Text, Value) :-
    atom(Text),
    atom_concat('http://www.w3.org/2001/XMLSchema#', Local, Type),
    memberchk(Local, [integer, int, long, short, byte, nonNegativeInteger, positiveInteger, unsignedInt, float, double, decimal]),
    atom_number(Text, Number), !,
    Value = Number.
typed_value(_, Text, Text).

%!  has_type(?Individual, ?Class) is nondet.
%
%   Classes that are stated and inherited; owl:Thing is a class of every individual.
has_type(Individual, Class) :-
    expand_prefixes(Class, Given),
    expand_prefixes(owl:'Thing', Thing),
    (   Given == Thing
    ->  thing(Individual)
    ;   nonvar(Given)
    ->  mindstage:rdfs_individual_of(Individual, Given)
    ;   distinct(Individual-Given, ( mindstage:rdfs_individual_of(Individual, Given) ; thing(Individual), Given = Thing ))
    ).

thing(Individual) :- nonvar(Individual), !, once(( mindstage:rdf(Individual, rdf:type, Type), \+ meta_class(Type) )).
thing(Individual) :- distinct(Individual, ( mindstage:rdf(Individual, rdf:type, Type), \+ meta_class(Type) )).

% Classes, properties and ontologies are no individuals.
meta_class('http://www.w3.org/2002/07/owl#NamedIndividual') :- !, fail.
meta_class('http://www.w3.org/2002/07/owl#Thing') :- !, fail.
meta_class(Type) :- sub_atom(Type, 0, _, _, 'http://www.w3.org/').

instance_of(Individual, Class) :- has_type(Individual, Class).

% is_a(?Entity, ?Class): an individual of the class, or a subclass of it.
is_a(Entity, Class) :- has_type(Entity, Class).
is_a(Entity, Class) :- subclass_of(Entity, Class).

is_individual(Individual) :- thing(Individual).
is_class(Class) :-
    (   var(Class) -> distinct(Class, ( mindstage:rdf(Class, rdf:type, owl:'Class'), atom(Class) ))
    ;   expand_prefixes(Class, Given), request(name_kinds(Given), Kinds), memberchk(class(_), Kinds)
    ).

%!  subclass_of(?Class, ?Superclass) is nondet.
%
%   Reflexive and transitive; owl:Thing is above all classes.
subclass_of(Class, Superclass) :-
    expand_prefixes(Class-Superclass, Lower-Upper),
    expand_prefixes(owl:'Thing', Thing),
    (   Upper == Thing
    ->  ( var(Lower) -> distinct(Lower, ( mindstage:rdfs_subclass_of(Lower, _) ; Lower = Thing )) ; is_class_name(Lower) )
    ;   nonvar(Upper)
    ->  mindstage:rdfs_subclass_of(Lower, Upper)
    ;   distinct(Lower-Upper, ( mindstage:rdfs_subclass_of(Lower, Upper)
                              ; ( var(Lower) -> mindstage:rdfs_subclass_of(Lower, Lower) ; is_class_name(Lower) ),
                                Upper = Thing ))
    ).

is_class_name('http://www.w3.org/2002/07/owl#Thing') :- !.
is_class_name(Class) :- request(name_kinds(Class), Kinds), memberchk(class(_), Kinds).

%!  is_at(?Object, ?Pose) is nondet.
%
%   Pose is [Frame, [X, Y, Z], [QX, QY, QZ, QW]]; Frame is map (the default) or another object.
is_at(Object, [Frame, Position, [X, Y, Z, W]]) :-
    (   ( var(Frame) ; Frame == map )
    ->  Frame = map,
        current_object_pose(Object, [map, _, Position, [X, Y, Z, W]])
    ;   expand_prefixes(Frame-Object, Base-Given),
        request(observe, Number),
        (   var(Given) -> current_object_pose(Given, [map|_]), Object = Given ; true ),
        request(pose_in(Number, Base, Given), Poses),
        member([Position, [W, X, Y, Z]], Poses)
    ).

has_part(Whole, Part) :- distinct(Whole-Part, question(part_of, [_, Part, Whole])).

% Bounding boxes: see the question where_is.
is_inside_of(Inner, Outer) :- distinct(Inner-Outer, question(where_is, [_, Inner, inside, Outer])).
is_supported_by(Object, Support) :- distinct(Object-Support, question(where_is, [_, Object, on, Support])).

% -- KnowRob of 2018 to 2019 ---------------------------------------------------------------------------------------------

kb_triple(Subject, Property, Value) :- triple(Subject, Property, Value).

%!  kb_type_of(?Individual, ?Class) is nondet.
%
%   Stated and inherited classes.
kb_type_of(Individual, Class) :- has_type(Individual, Class).

%!  kb_create(+Class, -Individual) is det.
%
%   A new individual of a class, or of each of a list of classes; options such as the graph are ignored.
kb_create(Class, Individual) :- kb_create(Class, Individual, _).
kb_create(Classes, Individual, _) :-
    ( is_list(Classes) -> Classes = [First|_] ; First = Classes ),
    new_iri(Individual, First),
    ( is_list(Classes) -> All = Classes ; All = [Classes] ),
    forall(member(Class, All), tell(has_type(Individual, Class))).

kb_assert(Subject, Property, Value) :- tell(triple(Subject, Property, Value)).
kb_assert(Subject, Property, Value, _) :- kb_assert(Subject, Property, Value).
kb_retract(Subject, Property, Value) :- forget(triple(Subject, Property, Value)).
kb_retract(Subject, Property, Value, _) :- kb_retract(Subject, Property, Value).

% -- time intervals of statements ----------------------------------------------------------------------------------------

%!  during(:Statement, ?Interval) is nondet.
%!  since(:Statement, ?Time) is nondet.
%!  until(:Statement, ?Time) is nondet.
%
%   Statement during [Begin, End]: what is stated holds at all times, from 0 to infinity; is_inside_of/2 and
%   is_supported_by/2 in the maximal intervals in which they held in an episode, of which a given interval is a part; and
%   occurs/1 in the interval of the event, which is a part of a given one. Two events, or intervals, are compared as by
%   temporal_relation/3. What is so since a time still is at the end of the episode.
during(_:A, B) :- is_temporal(A), !, temporal_relation(A, B, during).
during(_:Statement, Interval) :- held(Statement, Begin, End, Kind), !,
    Interval = [Since, Until],
    call_held(Statement, Begin, End),
    (   Kind == event -> at_least(Begin, Since), at_most(End, Until) ; at_most(Begin, Since), at_least(End, Until) ).
during(Statement, Interval) :-
    timeless(Statement),
    (   var(Interval) -> Interval = [0.0, inf] ; Interval = [Begin, End], unbound_is(Begin, 0.0), unbound_is(End, inf) ),
    ask(Statement).
since(_:Statement, Time) :- held(Statement, Begin, End, Kind), !,
    call_held(Statement, Begin, End),
    (   Kind == event -> at_least(Begin, Time) ; once(( episode(_, [_, Last]), End =:= Last )), at_most(Begin, Time) ).
since(Statement, Time) :- timeless(Statement), unbound_is(Time, 0.0), ask(Statement).
until(_:Statement, Time) :- held(Statement, Begin, End, Kind), !,
    call_held(Statement, Begin, End),
    (   Kind == event -> at_most(End, Time) ; at_least(End, Time), Begin =< Time ).
until(Statement, Time) :- timeless(Statement), unbound_is(Time, inf), ask(Statement).

is_temporal(A) :- var(A), !.
is_temporal(A) :- atom(A), !.
is_temporal([Begin, End]) :- number(Begin), number(End).

% held(+Statement, -Begin, -End, -Kind): a statement that episodes have intervals of, unless there is no episode.
held(Statement, _, _, Kind) :-
    nonvar(Statement),
    ( Statement = is_inside_of(_, _) -> Kind = relation ; Statement = is_supported_by(_, _) -> Kind = relation
    ; Statement = occurs(_), Kind = event ),
    once(episode(_)).

call_held(is_inside_of(A, B), Begin, End) :- mindstage:holds(inside, A, B, Begin, End).
call_held(is_supported_by(A, B), Begin, End) :- mindstage:holds(on, A, B, Begin, End).
call_held(occurs(Event), Begin, End) :- occurs(Event, [Begin, Stop]), ( var(Stop) -> End = inf ; End = Stop ).

at_least(Value, Bound) :- ( var(Bound) -> Bound = Value ; Value >= Bound ).
at_most(Value, Bound) :- ( var(Bound) -> Bound = Value ; Value =< Bound ).

unbound_is(Time, Default) :- ( var(Time) -> Time = Default ; true ).

timeless(_:Statement) :-
    goal(Statement, Goal),
    must_be(callable, Goal),
    comma_list(Goal, Goals),
    forall(member(Each, Goals), require_timeless(Each)).

require_timeless(Goal) :-
    functor(Goal, Name, Arity),
    memberchk(Name/Arity, [ triple/3, holds/3, has_type/2, instance_of/2, subclass_of/2, is_a/2, is_individual/1, is_class/1,
                            kb_triple/3, kb_type_of/2 ]), !.
require_timeless(Goal) :-
    format(string(Sentence), "~p has no interval of time: no episode was added, or it is none of is_inside_of/2, is_supported_by/2 and occurs/1",
           [Goal]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).

% -- descriptions of entities --------------------------------------------------------------------------------------------

%!  entity(?Entity, ?Description) is nondet.
%
%   Description is a class, an individual, or [Article, Type|Properties] as in openEASE: Type is object or event, and a
%   property is [type, Class], [name, Individual], [pose, [a, pose, Position, Quaternion]], [on, Other] and the other
%   relations of where_is, or [Property, Value], in which Value may be a description. An unbound description is built.
entity(Entity, Description) :- is_partial(Description), !,
    full_name(Entity, individual, Iri),
    distinct(Iri, current_object_pose(Iri, [map|_])),
    once(map_object_type(Iri, Class)),
    once(current_object_pose(Iri, [map, _, Position, Quaternion])),
    Description = [an, object, [type, Class], [name, Iri], [pose, [a, pose, Position, Quaternion]]],
    bind(Entity, Iri).
entity(Entity, Description) :- \+ is_list(Description), !,
    expand_prefixes(Description, Given),
    must_be(atom, Given),
    request(name_kinds(Given), Kinds),
    (   memberchk(class(Class), Kinds) -> has_type(Entity, Class)
    ;   memberchk(individual(Individual), Kinds) -> individual_name(Entity, Individual)
    ;   existence_error(entity, Description)
    ).
entity(Entity, [Article, Type|Properties]) :-
    must_be(oneof([a, an]), Article),
    candidates(Type, Properties, Kind),
    maplist(valid_property, Properties),
    selective_first(Properties, Ordered),
    distinct(Entity, described(Kind, Entity, Ordered)).

% is_partial(@Term): a variable, or a list with a variable at its end.
is_partial(Term) :- var(Term), !.
is_partial([_|Rest]) :- is_partial(Rest).

candidates(Type, _, _) :- var(Type), !, instantiation_error(Type).
candidates(object, _, object) :- !.
candidates(event, _, event) :- !.
candidates(action, _, event) :- !.
candidates(Type, _, _) :- knowrob_kind(Type), !,
    format(string(Sentence), "~w has no individuals here: poses and times are values, not entities", [Type]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).
candidates(Type, _, class(Class)) :- type_class(Type, Class).

knowrob_kind(Type) :- memberchk(Type, [pose, timepoint, interval, location, trajectory]).

valid_property(Property) :- is_list(Property), Property = [Key, _], nonvar(Key), !.
valid_property([Key, _, during|_]) :- nonvar(Key), !,
    throw(mindstage_error('InvalidArgumentError', "during: properties in descriptions have no intervals; the question holds/5 has those of relations")).
valid_property(Property) :- type_error(entity_property, Property).

% The name and the type are looked up first, since they leave few entities.
selective_first(Properties, Ordered) :-
    partition([[Key|_]]>>memberchk(Key, [name, type]), Properties, First, Rest),
    append(First, Rest, Ordered).

described(Kind, Entity, Properties) :-
    ( Properties = [[Key|_]|_], memberchk(Key, [name, type]) -> true ; var(Entity) -> of_kind(Kind, Entity) ; true ),
    described_all(Properties, Entity),
    once(of_kind(Kind, Entity)).

of_kind(object, Entity) :- distinct(Entity, current_object_pose(Entity, [map|_])).
of_kind(event, Entity) :- occurs(Entity).
of_kind(class(Class), Entity) :- has_type(Entity, Class).

described_all([], _).
described_all([[Key, Value]|Properties], Entity) :-
    described_by(Key, Value, Entity),
    described_all(Properties, Entity).

described_by(type, Type, Entity) :- !,
    (   var(Type) -> map_object_type(Entity, Type) ; type_class(Type, Class), has_type(Entity, Class) ).
described_by(name, Name, Entity) :- !,
    (   var(Name) -> Name = Entity
    ;   expand_prefixes(Name, Given), request(name_kinds(Given), Kinds), memberchk(individual(Iri), Kinds),
        individual_name(Entity, Iri)
    ).
described_by(pose, Pose, Entity) :- !,
    Pose = [a, pose, Position, Quaternion],
    current_object_pose(Entity, [map, _, Position, Quaternion]).
described_by(Key, Value, Entity) :- spatial_key(Key, Relation), !,
    question(where_is, [_, Entity, Relation, Other]),
    value_of(Value, Other).
described_by(Key, Value, Entity) :-
    key_property(Key, Property),
    triple(Entity, Property, Found),
    value_of(Value, Found).

individual_name(Entity, Iri) :- var(Entity), !, Entity = Iri.
individual_name(Entity, Iri) :- expand_prefixes(Entity, Given), request(name_kinds(Given), Kinds), memberchk(individual(Iri), Kinds).

spatial_key(on, on).
spatial_key(supported_by, on).
spatial_key(inside, inside).
spatial_key(inside_of, inside).
spatial_key(above, above).
spatial_key(below, below).
spatial_key(next_to, next_to).

% value_of(?Given, +Found): a variable, a description, a number, a text or a name.
value_of(Given, Found) :- var(Given), !, Given = Found.
value_of([Article|Description], Found) :- memberchk(Article, [a, an]), !, entity(Found, [Article|Description]).
value_of(Given, Found) :- number(Given), !, number(Found), Given =:= Found.
value_of(Given, Found) :- string(Given), !, atom_string(Found, Given).
value_of(Given, Found) :- expand_prefixes(Given, Iri), Iri == Found, !.
value_of(Given, Found) :-
    atom(Given), atom(Found),
    once(( candidate_name(Given, Name), request(name_kinds(Name), Kinds), member(Kind, Kinds), arg(1, Kind, Found) )).

key_property(Key, Property) :-
    (   Key = _:_ -> expand_prefixes(Key, Property)
    ;   candidate_name(Key, Name), request(name_kinds(Name), Kinds), memberchk(property(Property), Kinds) -> true
    ;   existence_error(property, Key)
    ).

% type_class(+Type, -Class): milk_carton is MilkCarton; for a word that names no class with individuals, the classes with
% individuals that contain it.
type_class(Type, Class) :-
    expand_prefixes(Type, Given),
    must_be(atom, Given),
    (   candidate_name(Given, Name), request(name_kinds(Name), Kinds), memberchk(class(Named), Kinds)
    ->  (   \+ has_type(_, Named), words_classes(Given, Classes)
        ->  member(Class, Classes)
        ;   Class = Named
        )
    ;   words_classes(Given, Classes)
    ->  member(Class, Classes)
    ;   existence_error(class, Type)
    ).

words_classes(Word, Classes) :-
    \+ sub_atom(Word, _, _, _, :),
    request(classes_with_word(Word), Classes),
    Classes \== [],
    print_message(informational, mindstage_word_classes(Word, Classes)).

% candidate_name(+Name, -Candidate): as it is, in camel case, and in camel case with a lower first letter.
candidate_name(Name, Name).
candidate_name(Name, Candidate) :-
    atom(Name),
    atomic_list_concat([First|Rest], '_', Name),
    maplist(capitalized, Rest, Words),
    ( capitalized(First, Word) ; Word = First ),
    atomic_list_concat([Word|Words], Candidate),
    Candidate \== Name.

capitalized(Word, Capitalized) :-
    sub_atom(Word, 0, 1, _, First),
    sub_atom(Word, 1, _, 0, Rest),
    upcase_atom(First, Upper),
    atom_concat(Upper, Rest, Capitalized).

% -- showing -------------------------------------------------------------------------------------------------------------

%!  show(+Things) is semidet.
%!  show(+Things, +Color) is semidet.
%
%   Highlights an individual, a list of them, or all entities of a description.
show(Things) :- show(Things, green).
show(Things, Color) :-
    (   Things = [Article|_], memberchk(Article, [a, an])
    ->  findall(Thing, entity(Thing, Things), Shown), Shown \== []
    ;   Shown = Things
    ),
    mindstage:highlight(Shown, Color).

:- dynamic marker_state/2.

%!  marker(+Term, -Marker) is det.
%
%   Adds a marker: cube(Id), sphere(Id), cylinder(Id), cone(Id), arrow(Id), text(Id, Text), or object(Individual), a copy
%   of a body at its present pose. Marker is the id.
marker(Term, Id) :-
    must_be(callable, Term),
    marker_record(Term, Id, Record),
    set_marker(Id, Record).

marker_record(object(Object), Id, marker(body_copy, [Position, [W, X, Y, Z]], [1, 1, 1], [0, 0.6, 1, 0.6], Id)) :- !,
    once(current_object_pose(Object, [map, Id, Position, [X, Y, Z, W]])).
marker_record(text(Id, Text), Id, marker(text, [[0, 0, 0], [1, 0, 0, 0]], [0.1, 0.1, 0.1], [1, 1, 1, 1], Text)) :- !.
marker_record(Term, Id, marker(Type, [[0, 0, 0], [1, 0, 0, 0]], [0.1, 0.1, 0.1], [1, 1, 0, 1], '')) :-
    Term =.. [Type, Id],
    memberchk(Type, [cube, sphere, cylinder, cone, arrow]), !.
marker_record(Term, _, _) :-
    domain_error('cube(Id), sphere(Id), cylinder(Id), cone(Id), arrow(Id), text(Id, Text) or object(Individual)', Term).

set_marker(Id, Record) :-
    must_be(atom, Id),
    Record = marker(Type, Pose, Size, Color, Text),
    request(add_marker(Id, Type, Pose, Size, Color, Text), _),
    retractall(marker_state(Id, _)),
    assertz(marker_state(Id, Record)).

known_marker(Id, Record) :- must_be(atom, Id), ( marker_state(Id, Record) -> true ; existence_error(marker, Id) ).

% marker_pose(+Marker, +Pose): [Frame, Position, [QX, QY, QZ, QW]] in the frame map.
marker_pose(Id, [map, Position, [X, Y, Z, W]]) :-
    known_marker(Id, marker(Type, _, Size, Color, Text)),
    set_marker(Id, marker(Type, [Position, [W, X, Y, Z]], Size, Color, Text)).

marker_scale(Id, Size) :-
    known_marker(Id, marker(Type, Pose, _, Color, Text)),
    set_marker(Id, marker(Type, Pose, Size, Color, Text)).

% marker_color(+Marker, +Color): [R, G, B] or [R, G, B, Opacity] from 0 to 1.
marker_color(Id, Color) :-
    known_marker(Id, marker(Type, Pose, Size, _, Text)),
    ( Color = [_, _, _] -> append(Color, [1], Shown) ; Shown = Color ),
    set_marker(Id, marker(Type, Pose, Size, Shown, Text)).

marker_remove(Id) :-
    must_be(atom, Id),
    retractall(marker_state(Id, _)),
    request(remove_marker(Id), true).

% -- predicates that are not here ----------------------------------------------------------------------------------------

%!  knowrob_not_here(?Predicate, ?Reason) is nondet.
%
%   Predicates of KnowRob that Mindstage does not have: a call throws existence_error(procedure, Predicate) with the reason.
knowrob_not_here(Predicate, Reason) :- not_here(Predicates, Reason), member(Predicate, Predicates).

not_here([object_trajectory/4], "the question trajectory/5 has the poses of a thing in an episode").
not_here([event_before/2, event_after/2], "before/2, after/2 and the other relations of Allen compare events").
not_here([task_goal/2], "the events that are detected in episodes have no goals").
not_here([mem_episode_start/1, mem_episode_stop/1], "mindstage record, or record of a Simulation, records an episode").
not_here([assert_temporal_part/4], "the question holds/5 has the intervals in which relations held").
not_here([map_read_all/2], "everything_in_map/2 and current_object_pose/2 list a map").
not_here([object_information/8], "the question what_is/11 gives classes, pose, size and other properties").
not_here([object_assert_color/2], "tell(triple(Object, knowrob:mainColorOfObject, Text)) states a color").
not_here([object_assert_dimensions/4], "sizes are part of the world that an engine simulates; change the map").
not_here([create_object_perception/4, create_perception_instance/2, set_perception_pose/2, set_object_perception/2],
         "nothing is perceived here; tell(is_at(Object, Pose)) moves a body, spawn_models/2 spawns one").
not_here([create_joint_information/9], "spawn_constraint/1 creates a joint").
not_here([update_joint_information/7], "the joints of a running simulation move by forces").
not_here([delete_object_information/1], "forget/1 removes statements").
not_here([comp_center/2], "current_object_pose/2 has the center").
not_here([objectAtPoint2D/2], "points of a map are no individuals; on_Physical/2 asks what is below an object").
not_here([mng_latest_designator/4, mng_lookup_transform/4, mng_designator/2, mng_query/2],
         "no MongoDB is used; the present state is in the simulation, see current_object_pose/2").
not_here([tf_lookup_transform/3, tf_listener_start/0, transform_pose_prolog/4],
         "there is no tf listener in Prolog; is_at/2 gives a pose in the frame of another object").
not_here([jpl_load_library/0, json_prolog_init/0, ros_init/0],
         "no Java and no ROS node runs in the process; `mindstage serve` serves ROS clients").
not_here([visualisation_canvas/1, camera_pose/2], "the option `--viewer` shows the world in the browser").
not_here([visualisation_canvas/0, clear_canvas/0],
         "the option `--viewer` shows the world in the browser; unhighlight/0 removes the highlights").
not_here([add_object/1, add_object/2, add_objects/1, add_object_with_children/1, add_object_with_children/2,
          update_object/1, update_object_with_children/1],
         "the page shows all bodies of a spawned map, where they are; show/1 highlights some").
not_here([marker_update/0, marker_update/1, marker_update/2, marker_publish/0, marker_touch/1],
         "markers and bodies are shown as soon as they exist; \c
          show/1 highlights an object, marker(object(Object), Marker) adds a copy of it").
not_here([marker_highlight/1, marker_highlight/2, highlight_object/1, highlight_object/2,
          highlight_object_with_children/1],
         "highlight/1 and highlight/2 color individuals, or a list of them").
not_here([marker_highlight_remove/1, marker_highlight_remove/0, reset_highlighting/0],
         "unhighlight/0 removes all highlights").
not_here([remove_object/1, remove_object_with_children/1, marker_hide/1, marker_show/1, u_marker_remove_all/0],
         "marker_remove/1 removes a marker; the page's list of bodies hides and shows them").
not_here([add_text/1, add_text/3, marker_text/2],
         "marker(text(Id, Text), Marker) shows a text, and marker_pose/2 places it").
not_here([add_trajectory/4, add_trajectory/5, add_avg_trajectory/5],
         "the question trajectory/5 has the poses; the page shows the path of a selected body of an episode").
not_here([show_marker/2, show_marker/3, show_markers/1], "marker(Term, Marker) adds a marker, which is shown at once").
not_here([data_vis/2], "no charts are drawn; `--json` of `mindstage ask` gives tables to other programs").
not_here([designator_publish/1, designator_publish/2, designator_publish_image/1],
         "the page shows no designators; perform/2 takes one").
not_here([camera_transform/1], "the page and `mindstage shot --from X,Y,Z --to X,Y,Z` have a camera").
not_here([sem_map_inst/1], "everything_in_map/2 has the maps, and what is in them").
not_here([connect_to_db/1, u_load_episodes/1, ep_inst/1],
         "no MongoDB is used; the option `--episode FILE` loads an episode").
not_here([u_occurs/4], "occurs/2 has the events of the episode of `--episode`, with their times").
not_here([belief_parse/1], "spawn_semantic_map/1 spawns a map that owl_parse/1 has loaded").
not_here([classifier_trained/4, classify_instances/3, best_location_dtree/2],
         "no classifier (Weka) is part of Mindstage; storagePlaceFor/2 answers from the ontology").
not_here([rdf_wup_similarity/3, best_location_maxMaxWup/2, best_location_maxMaxWup/3],
         "class similarity is no measure here; the question siblings/3 gives classes with a common superclass").
not_here([export_object/2, export_map/2, export_action/2], "`mindstage log` and `mindstage convert` write maps and worlds").
not_here([cap_available_on_robot/2, comp_type_available/2],
         "the questions can/2 and missing_for_action/6 answer for actions, with the components and what is missing").
not_here([urdf_load/2, urdf_load/3], "`--urdf FILE` loads a URDF with its map").

define_not_here :-
    forall(knowrob_not_here(Name/Arity, _), define_not_here(Name, Arity)).

define_not_here(Name, Arity) :-
    functor(Head, Name, Arity),
    assertz((Head :- mindstage_knowrob_language:throw_not_here(Name/Arity))),
    compile_predicates([Name/Arity]),
    export(Name/Arity).

throw_not_here(Predicate) :- throw(error(existence_error(procedure, Predicate), _)).

:- initialization(define_not_here, now).

:- multifile prolog:error_message//1, prolog:message//1.

prolog:error_message(existence_error(procedure, Predicate)) -->
    { ground(Predicate), mindstage_knowrob_language:knowrob_not_here(Predicate, Reason) },
    [ '~q of KnowRob is not here: ~w'-[Predicate, Reason] ].
prolog:message(mindstage_word_classes(Word, Classes)) -->
    [ 'no individual is of a class named ~w, which is taken as ~p'-[Word, Classes] ].
