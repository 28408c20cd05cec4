% RDF predicates named like those of SWI-Prolog's semweb library (rdf_db, rdfs) and KnowRob, over Mindstage's store.
%
% Literals are literal(type(Type, Text)) and literal(lang(Language, Text)); plain literals have the type xsd:string.
% literal(Text) matches literals of any type.

:- module(mindstage_semweb,
          [ rdf/3, rdf_has/3, rdf_reachable/3, rdf_assert/3, rdf_retractall/3,
            rdfs_individual_of/2, rdfs_subclass_of/2, rdfs_label/2,
            owl_has/3, owl_individual_of/2, owl_subclass_of/2 ]).
:- reexport(prefixes, except([expand_prefixes/2, abbreviated_name/2, set_default_prefixes/1])).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(library(error)).
:- use_module(library(lists)).

rdf(Subject, Property, Value) :- answers(rdf(Subject, Property, Value)).

% rdf_has(?Subject, ?Property, ?Value): includes subproperties and inverse properties.
rdf_has(Subject, Property, Value) :- answers(rdf_has(Subject, Property, Value)).
owl_has(Subject, Property, Value) :- rdf_has(Subject, Property, Value).

rdfs_individual_of(Individual, Class) :- answers(rdfs_individual_of(Individual, Class)).
owl_individual_of(Individual, Class) :- rdfs_individual_of(Individual, Class).

rdfs_subclass_of(Class, Superclass) :- answers(rdfs_subclass_of(Class, Superclass)).
owl_subclass_of(Class, Superclass) :- rdfs_subclass_of(Class, Superclass).

rdfs_label(Resource, Label) :-
    rdf_has(Resource, rdfs:label, literal(Literal)),
    arg(2, Literal, Label).

rdf_assert(Subject, Property, Value) :- request(rdf_assert(Subject, Property, Value), _).
rdf_retractall(Subject, Property, Value) :- request(rdf_retractall(Subject, Property, Value), _).

% rdf_reachable(?Subject, +Property, ?Value): reflexive transitive closure of rdf_has/3; one end must be bound.
rdf_reachable(Subject, Property, Value) :-
    nonvar(Subject), !,
    expand_prefixes(Subject, Start),
    reachable([Start], forward(Property), [Start], Reached),
    expand_prefixes(Value, Wanted),
    member(Wanted, Reached).
rdf_reachable(Subject, Property, Value) :-
    nonvar(Value), !,
    expand_prefixes(Value, End),
    reachable([End], backward(Property), [End], Reached),
    member(Subject, Reached).
rdf_reachable(_, _, _) :- instantiation_error(_).

reachable([], _, _, []).
reachable([Node|Queue0], Direction, Seen, [Node|Reached]) :-
    findall(Next, ( edge(Direction, Node, Next), \+ memberchk(Next, Seen) ), Found),
    list_to_set(Found, New),
    append(Queue0, New, Queue),
    append(Seen, New, Known),
    reachable(Queue, Direction, Known, Reached).

edge(forward(Property), Node, Next) :- atom(Node), rdf_has(Node, Property, Next).
edge(backward(Property), Node, Next) :- rdf_has(Next, Property, Node).

% -- replacing SWI-Prolog's libraries ----------------------------------------------------------------------------------

% Files written for KnowRob load SWI-Prolog's RDF libraries, whose store is empty here; this module is loaded instead.
% Within SWI-Prolog's own libraries nothing is replaced.
:- multifile user:prolog_load_file/2.
:- dynamic user:prolog_load_file/2.

user:prolog_load_file(_:Library, _) :- mindstage_semweb:replaced(Library).

replaced(library(Library)) :-
    memberchk(Library, [semweb/rdf_db, semweb/rdfs, 'semweb/rdf_db', 'semweb/rdfs', rdfs, owl, owl_parser]),
    prolog_load_context(source, Source),
    current_prolog_flag(home, Home),
    \+ sub_atom(Source, 0, _, _, Home).
