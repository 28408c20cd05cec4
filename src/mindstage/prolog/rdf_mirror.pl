% The statements of Mindstage's store in SWI-Prolog's own rdf_db, kept in step with the store.
%
% Python marks the mirror as stale when the store changes, and the next read copies what has changed. Reads therefore cost
% what rdf_db costs. A store that cannot be copied (a SPARQL endpoint, or one that is too large) is asked instead.

:- module(mindstage_rdf_mirror, [mirrored/0, mark_stale/0, load_rdf_db/0, class_member/2, class_of/2, superclass/2, subclass/2, superproperty/2, restriction_of/2,
                                 property_expressions/2, implied_property/2]).
:- use_module(questions).
:- use_module(library(lists)).

:- dynamic stale/0, is_remote/0, copied/1,
           listed/2, class_member_/2, class_of_/2, superclass_/2, subclass_/2, expressions_/2, implied_/2, superproperty_/2, restriction_/2, computables_/2.

stale.

% mirrored: brings the mirror up to date; fails if the store has to be asked.
mirrored :-
    (   stale -> with_mutex(mindstage_rdf_mirror, synchronize) ; true ),
    \+ is_remote.

% mark_stale: called by Python after each change, and when a console is opened.
mark_stale :- ( stale -> true ; assertz(stale) ).

synchronize :- \+ stale, !.
synchronize :-
    load_rdf_db,
    retractall(stale),
    (   copied(Before) -> true ; Before = none ),
    catch(( request(rdf_changes(Before), Changes), apply_changes(Changes) ), Error,
          ( retractall(copied(_)), mark_stale, throw(Error) )).

load_rdf_db :-
    load_files([library(semweb/rdf_db), library(semweb/rdf_ntriples)], [if(not_loaded), imports([]), silent(true)]).

apply_changes(unchanged).
apply_changes(remote) :-
    forget_derived,
    retractall(copied(_)),
    ( is_remote -> true ; assertz(is_remote) ).
apply_changes(changed(Changes)) :-
    forget_derived,
    forall(member(Change, Changes), apply_change(Change)).
apply_changes(copy(Name, File)) :-
    forget_derived,
    retractall(is_remote),
    retractall(copied(_)),
    rdf_db:rdf_reset_db,
    rdf_ntriples:rdf_process_ntriples(File, mindstage_rdf_mirror:add_quads, [format(nquads), anon_prefix('_:')]),
    delete_file(File),
    assertz(copied(Name)).

apply_change(added(Subject, Property, Value, Graph)) :- add_quad(quad(Subject, Property, Value, Graph)).
apply_change(removed(Subject, Property, Value, Graph)) :-
    graph_name(Graph, Name),
    rdf_db:rdf_retractall(Subject, Property, Value, Name).

add_quads(Quads, _) :- forall(member(Quad, Quads), add_quad(Quad)).

add_quad(quad(Subject, Property, Value, Graph)) :-
    typed(Value, Typed),
    graph_name(Graph, Name),
    rdf_db:rdf_assert(Subject, Property, Typed, Name).
add_quad(rdf(Subject, Property, Value)) :- add_quad(quad(Subject, Property, Value, user)).
add_quad(rdf(Subject, Property, Value, Graph)) :- add_quad(quad(Subject, Property, Value, Graph)).

% graph_name(+Iri, -Name): as rdf_assert/3 and rdf_assert/4 name graphs.
graph_name('http://mindstage.org/told', user) :- !.
graph_name(Iri, Name) :- atom_concat('urn:graph:', Name, Iri), !.
graph_name(Iri, Iri).

% An untyped text is an xsd:string, as in RDF 1.1.
typed(literal(Text), Typed) :- atom(Text), !, Typed = literal(type('http://www.w3.org/2001/XMLSchema#string', Text)).
typed(Value, Value).

% -- what follows ------------------------------------------------------------------------------------------------------

% What the reasoner of the knowledge base infers, asked once for each class and property, and forgotten with each change.
forget_derived :-
    forall(member(Table, [listed(_, _), class_member_(_, _), class_of_(_, _), superclass_(_, _), subclass_(_, _),
                          expressions_(_, _), implied_(_, _), superproperty_(_, _), restriction_(_, _), computables_(_, _)]),
           retractall(Table)).

% class_member(+Class, ?Individual)
class_member(Class, Individual) :- list_once(class_member_, Class), class_member_(Class, Individual).
% class_of(+Individual, ?Class): asserted, inferred and inherited classes.
class_of(Individual, Class) :- list_once(class_of_, Individual), class_of_(Individual, Class).
% superclass(+Class, ?Superclass), subclass(+Class, ?Subclass): the class itself is the first.
superclass(Class, Superclass) :- list_once(superclass_, Class), superclass_(Class, Superclass).
subclass(Class, Subclass) :- list_once(subclass_, Class), subclass_(Class, Subclass).
% implied_property(+Property, ?Sub): subproperties, the property itself is the first.
implied_property(Property, Sub) :- list_once(implied_, Property), implied_(Property, Sub).

superproperty(Property, Super) :- list_once(superproperty_, Property), superproperty_(Property, Super).

% restriction_of(+Class, ?Restriction): restriction(Property, Condition), see owl_predicates.pl; the nearest first.
restriction_of(Class, Restriction) :- list_once(restriction_, Class), restriction_(Class, Restriction).

% property_expressions(+Property, -Expressions): forward(Name) and backward(Name) that imply the property and are in use.
property_expressions(Property, Expressions) :- expressions_(Property, Expressions), !.
property_expressions(Property, Expressions) :-
    request(rdf_table(expressions_, Property), Expressions),
    assertz(expressions_(Property, Expressions)).

list_once(Table, Name) :- listed(Table, Name), !.
list_once(Table, Name) :- with_mutex(mindstage_rdf_mirror, list(Table, Name)).

list(Table, Name) :- listed(Table, Name), !.
list(Table, Name) :-
    request(rdf_table(Table, Name), Others),
    forall(member(Other, Others), ( Fact =.. [Table, Name, Other], assertz(Fact) )),
    assertz(listed(Table, Name)).
