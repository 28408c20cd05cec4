% Triples, under the names of SWI-Prolog's semweb library (rdf_db, rdfs) and KnowRob's, over Mindstage's own store.
%
% Literals are literal(type(Type, Text)) and literal(lang(Language, Text)); a text without a type is an xsd:string.
% literal(Text) asks for a text whatever its type.

:- module(mindstage_semweb,
          [ rdf/3, rdf_has/3, rdf_reachable/3, rdf_assert/3, rdf_retractall/3,
            rdfs_individual_of/2, rdfs_subclass_of/2, rdfs_label/2,
            owl_has/3, owl_individual_of/2, owl_subclass_of/2 ]).
:- reexport(names, except([spelt/2, shown_name/2, keep_prefixes/1])).
:- use_module(asking).
:- use_module(names).
:- use_module(library(error)).
:- use_module(library(lists)).

rdf(Subject, Property, Value) :- answers(rdf(Subject, Property, Value)).

% rdf_has(?Subject, ?Property, ?Value): those of properties that imply it, and of its inverse, too.
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

% rdf_reachable(?Subject, +Property, ?Value): any number of steps of rdf_has/3, none among them; one end is given.
rdf_reachable(Subject, Property, Value) :-
    nonvar(Subject), !,
    spelt(Subject, Start),
    reached([Start], forth(Property), [Start], Reached),
    spelt(Value, Wanted),
    member(Wanted, Reached).
rdf_reachable(Subject, Property, Value) :-
    nonvar(Value), !,
    spelt(Value, End),
    reached([End], back(Property), [End], Reached),
    member(Subject, Reached).
rdf_reachable(_, _, _) :- instantiation_error(_).

reached([], _, _, []).
reached([Here|Waiting], Way, Seen, [Here|Reached]) :-
    findall(Next, ( step(Way, Here, Next), \+ memberchk(Next, Seen) ), Found),
    list_to_set(Found, New),
    append(Waiting, New, Queue),
    append(Seen, New, Known),
    reached(Queue, Way, Known, Reached).

step(forth(Property), Here, Next) :- atom(Here), rdf_has(Here, Property, Next).
step(back(Property), Here, Next) :- rdf_has(Next, Property, Here).

% -- files that load SWI-Prolog's own ----------------------------------------------------------------------------------

% Users' files written for KnowRob begin by loading the store of SWI-Prolog, in which nothing is; they get this one.
% SWI-Prolog's own libraries still load what they ask for.
:- multifile user:prolog_load_file/2.
:- dynamic user:prolog_load_file/2.

user:prolog_load_file(_:Library, _) :- mindstage_semweb:replaced(Library).

replaced(library(Library)) :-
    memberchk(Library, [semweb/rdf_db, semweb/rdfs, 'semweb/rdf_db', 'semweb/rdfs', rdfs, owl, owl_parser]),
    prolog_load_context(source, Source),
    current_prolog_flag(home, Home),
    \+ sub_atom(Source, 0, _, _, Home).
