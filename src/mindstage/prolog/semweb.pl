% RDF predicates named like those of SWI-Prolog's semweb library (rdf_db, rdfs) and KnowRob, over Mindstage's store.
%
% Reads use a mirror of the store in SWI-Prolog's rdf_db (rdf_mirror.pl), writes go to the store. Literals are
% literal(type(Type, Text)) and literal(lang(Language, Text)); plain literals have the type xsd:string. literal(Text)
% matches literals of any type.
%
% Computed properties are clauses of the multifile predicate mindstage_semweb:computable(+Property, ?Subject, ?Value) in
% any file, whose first argument is a full IRI (an atom), for example
%
%     mindstage_semweb:computable('http://knowrob.org/kb/knowrob.owl#on-Physical', Above, Below) :- on_physical(Above, Below).
%
% rdf_has/3 (with a bound property), rdf_triple/3 and owl_has/3 return their solutions after the statements of the store,
% each once, also for the superproperties of the property. A value is an atom (a resource) or a literal as above.

:- module(mindstage_semweb,
          [ rdf/3, rdf/4, rdf_has/3, rdf_has/4, rdf_reachable/3, rdf_reachable/5, rdf_triple/3, owl_triple/3,
            rdf_assert/3, rdf_assert/4, rdf_retractall/3, rdf_retractall/4, rdf_update/4, rdf_update/5,
            rdf_transaction/1, rdf_transaction/2, rdf_subject/1, rdf_resource/1, rdf_current_predicate/1, rdf_graph/1,
            rdf_load/1, rdf_load/2, rdf_unload/1, rdf_reset_db/0, rdf_statistics/1, rdf_generation/1,
            rdf_is_resource/1, rdf_is_literal/1, rdf_literal_value/2, rdf_is_bnode/1, rdf_node/1, rdf_bnode/1,
            rdf_equal/2, rdf_global_object/2, rdf_global_term/2, rdf_split_url/3, rdf_url_namespace/2,
            rdf_member_property/2, rdf_match_label/3, lang_equal/2, lang_matches/2,
            rdfs_individual_of/2, rdfs_instance_of/2, rdfs_subclass_of/2, rdfs_subproperty_of/2, rdfs_class_property/2,
            rdfs_label/2, rdfs_label/3, rdfs_member/2, rdfs_list_to_prolog_list/2, rdfs_assert_list/2,
            op(1150, fx, rdf_meta)
          ]).
:- reexport(prefixes, except([expand_prefixes/2, abbreviated_name/2, set_default_prefixes/1])).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(rdf_mirror).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(rbtrees)).
:- use_module(library(semweb/rdf_prefixes), [(rdf_meta)/1, op(_, _, rdf_meta)]).
:- use_module(library(solution_sequences)).

:- multifile computable/3.
:- dynamic computable/3.

% Prefixed names in the goals of users' files are expanded when the files are loaded.
:- rdf_meta
    rdf(r, r, o), rdf(r, r, o, r), rdf_has(r, r, o), rdf_has(r, r, o, -), rdf_reachable(r, r, o),
    rdf_reachable(r, r, o, +, -), rdf_triple(r, r, o), owl_triple(r, r, o), rdf_assert(r, r, o), rdf_assert(r, r, o, +),
    rdf_retractall(r, r, o), rdf_retractall(r, r, o, ?), rdf_update(r, r, o, t), rdf_update(r, r, o, +, t),
    rdf_subject(r), rdf_equal(o, o), rdfs_individual_of(r, r), rdfs_instance_of(r, r), rdfs_subclass_of(r, r),
    rdfs_subproperty_of(r, r), rdfs_class_property(r, r), rdfs_label(r, -), rdfs_label(r, ?, -), rdfs_member(r, r),
    rdfs_list_to_prolog_list(r, -), rdfs_assert_list(t, r).

% -- statements --------------------------------------------------------------------------------------------------------

rdf(Subject, Property, Value) :- mirrored, !,
    resource(Subject, S),
    resource(Property, P),
    pattern(Value, Pattern),
    matching(Pattern, S, P).
rdf(Subject, Property, Value) :- answers(rdf(Subject, Property, Value)).

% rdf(?Subject, ?Property, ?Value, ?Graph): the graph is the address of a source, or where statements are asserted.
rdf(Subject, Property, Value, Source) :-
    require_mirror(rdf/4),
    resource(Subject, S),
    resource(Property, P),
    pattern(Value, Pattern),
    ( nonvar(Source), Source = Graph:_ -> true ; Graph = Source ),
    matching_in(Pattern, S, P, Graph).

matching(value(Value), S, P) :- rdf_db:rdf(S, P, Value).
matching(text(Text), S, P) :- rdf_db:rdf(S, P, literal(exact(Text), Literal)), arg(2, Literal, Found), Found == Text.

matching_in(value(Value), S, P, Graph) :- rdf_db:rdf(S, P, Value, Source), source_graph(Source, Graph).
matching_in(text(Text), S, P, Graph) :-
    rdf_db:rdf(S, P, literal(exact(Text), Literal), Source),
    arg(2, Literal, Found),
    Found == Text,
    source_graph(Source, Graph).

source_graph(Source, Graph) :- ( Source = Found:_ -> Graph = Found ; Graph = Source ).

require_mirror(_) :- mirrored, !.
require_mirror(Indicator) :-
    format(string(Sentence), "~q is not available for a store that is asked by queries (an endpoint, or one too large)",
           [Indicator]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).

resource(Resource, Resource) :- ( var(Resource) ; atom(Resource) ), !.
resource(Text, Resource) :- string(Text), !, atom_string(Resource, Text).
resource(Prefix:Name, Resource) :- !, expand_prefixes(Prefix:Name, Resource).
resource(Term, _) :- refuse_value(Term, "is not a name").

% pattern(+Value, -Pattern): value(Value) for rdf_db, or text(Text) for a literal of any type.
pattern(Value, value(Value)) :- ( var(Value) ; atom(Value) ), !.
pattern(literal(Literal), Pattern) :- !, literal_pattern(Literal, Pattern).
pattern(literal(Search, Literal), value(literal(Search, Literal))) :- !.
pattern(Prefix:Name, value(Resource)) :- !, expand_prefixes(Prefix:Name, Resource).
pattern(Term, _) :-
    refuse_value(Term, "is neither a resource nor a literal; give an atom, or literal(Text), literal(type(Type, Text)), literal(lang(Language, Text))").

literal_pattern(Literal, value(literal(Literal))) :- var(Literal), !.
literal_pattern(Text, text(Atom)) :- atomic(Text), !, text_atom(Text, Atom).
literal_pattern(type(Type, Text), value(literal(type(Iri, Atom)))) :- !, resource(Type, Iri), text_atom(Text, Atom).
literal_pattern(lang(Language, Text), value(literal(lang(Language, Atom)))) :- !, text_atom(Text, Atom).
literal_pattern(Other, value(literal(Other))).

text_atom(Text, Text) :- ( var(Text) ; atom(Text) ), !.
text_atom(Text, Atom) :- atomic(Text), !, format(atom(Atom), "~w", [Text]).
text_atom(Text, Text).

refuse_value(Term, What) :-
    format(string(Sentence), "~q ~w", [Term, What]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).

% rdf_has(?Subject, ?Property, ?Value): includes subproperties, inverse properties and computed properties.
rdf_has(Subject, Property, Value) :- mirrored, !,
    resource(Subject, S),
    resource(Property, P),
    pattern(Value, Pattern),
    (   var(P)
    ->  matching(Pattern, S, P)
    ;   property_expressions(P, Expressions),
        (   computables(P, Computables), Computables \== []
        ->  has_or_computes(Expressions, Computables, Pattern, S)
        ;   has(Expressions, Pattern, S)
        )
    ).
rdf_has(Subject, Property, Value) :- answers(rdf_has(Subject, Property, Value)).

has([forward(Property)], Pattern, S) :- !, matching(Pattern, S, Property).
has(Expressions, Pattern, S) :-
    ground(S-Pattern), !,
    once(( member(Expression, Expressions), has_by(Expression, Pattern, S) )).
has(Expressions, Pattern, S) :-
    Pattern =.. [_, Value],
    distinct(S-Value, ( member(Expression, Expressions), has_by(Expression, Pattern, S) )).

has_by(forward(Property), Pattern, S) :- matching(Pattern, S, Property).
has_by(backward(Property), value(Value), S) :-
    \+ ( compound(Value) ),
    rdf_db:rdf(Value, Property, S),
    atom(S).

has_or_computes(Expressions, _, Pattern, S) :- has(Expressions, Pattern, S).
has_or_computes(Expressions, Computables, Pattern, S) :-
    Wanted = S-Value,
    distinct(Wanted, ( member(Computable, Computables), computes(Computable, S, Value) )),
    matches(Pattern, Value),
    \+ has(Expressions, value(Value), S).

matches(value(Value), Value).
matches(text(Text), literal(Literal)) :- arg(2, Literal, Found), Found == Text.

% rdf_has(?Subject, +Property, ?Value, -Asserted): Asserted is the property that is asserted, or inverse_of(Asserted).
rdf_has(Subject, Property, Value, Asserted) :-
    require_mirror(rdf_has/4),
    resource(Subject, S),
    resource(Property, P),
    pattern(Value, Pattern),
    (   var(P)
    ->  matching(Pattern, S, P), Asserted = P
    ;   property_expressions(P, Expressions),
        member(Expression, Expressions),
        has_by(Expression, Pattern, S),
        asserted_property(Expression, Asserted)
    ).

asserted_property(forward(Property), Property).
asserted_property(backward(Property), inverse_of(Property)).

% KnowRob's rdf_triple(?Property, ?Subject, ?Value): the property comes first.
rdf_triple(Property, Subject, Value) :- rdf_has(Subject, Property, Value).
owl_triple(Subject, Property, Value) :- rdf_has(Subject, Property, Value).

rdf_subject(Subject) :- require_mirror(rdf_subject/1), resource(Subject, S), rdf_db:rdf_subject(S).
rdf_resource(Resource) :- require_mirror(rdf_resource/1), resource(Resource, R), rdf_db:rdf_resource(R).
rdf_graph(Graph) :- require_mirror(rdf_graph/1), rdf_db:rdf_graph(Graph).
rdf_statistics(Key) :- require_mirror(rdf_statistics/1), rdf_db:rdf_statistics(Key).
rdf_generation(Generation) :- require_mirror(rdf_generation/1), rdf_db:rdf_generation(Generation).

rdf_current_predicate(Property) :-
    require_mirror(rdf_current_predicate/1),
    resource(Property, P),
    rdf_db:rdf_current_predicate(P),
    once(rdf_db:rdf(_, P, _)).

% -- reachability ------------------------------------------------------------------------------------------------------

% rdf_reachable(?Subject, +Property, ?Value): reflexive transitive closure of rdf_has/3; one end must be bound.
rdf_reachable(Subject, Property, Value) :- rdf_reachable(Subject, Property, Value, inf, _).

% rdf_reachable(?Subject, +Property, ?Value, +MaxSteps, -Steps): by at most so many steps; the nearest first.
rdf_reachable(Subject, Property, Value, Most, Steps) :-
    nonvar(Subject), !,
    resource(Subject, Start),
    ( nonvar(Value), Value = _:_ -> resource(Value, Wanted) ; Wanted = Value ),
    rb_new(Seen0),
    rb_insert_new(Seen0, Start, true, Seen),
    reached([Start], forward(Property), 0, Most, Seen, Wanted, Steps).
rdf_reachable(Subject, Property, Value, Most, Steps) :-
    nonvar(Value), !,
    pattern(Value, _),
    ( Value = _:_ -> resource(Value, End) ; End = Value ),
    rb_new(Seen0),
    rb_insert_new(Seen0, End, true, Seen),
    reached([End], backward(Property), 0, Most, Seen, Subject, Steps).
rdf_reachable(_, _, _, _, _) :- instantiation_error(_).

% reached(+Nodes, +Direction, +Depth, +Most, +Seen, ?Wanted, -Steps): Wanted is one of the nodes, or further away.
reached(Nodes, _, Depth, _, _, Wanted, Depth) :- member(Wanted, Nodes).
reached(Nodes, Direction, Depth, Most, Seen, Wanted, Steps) :-
    Nodes \== [],
    ( Most == inf -> true ; Depth < Most ),
    new_neighbors(Nodes, Direction, Seen, AllSeen, Next, []),
    Deeper is Depth + 1,
    reached(Next, Direction, Deeper, Most, AllSeen, Wanted, Steps).

new_neighbors([], _, Seen, Seen, New, New).
new_neighbors([Node|Nodes], Direction, Seen0, Seen, New0, New) :-
    findall(Next, edge(Direction, Node, Next), Found),
    unseen(Found, Seen0, Seen1, New0, New1),
    new_neighbors(Nodes, Direction, Seen1, Seen, New1, New).

unseen([], Seen, Seen, New, New).
unseen([Node|Nodes], Seen0, Seen, New0, New) :-
    (   rb_insert_new(Seen0, Node, true, Seen1)
    ->  New0 = [Node|New1]
    ;   Seen1 = Seen0, New1 = New0
    ),
    unseen(Nodes, Seen1, Seen, New1, New).

edge(forward(Property), Node, Next) :- atom(Node), rdf_has(Node, Property, Next).
edge(backward(Property), Node, Next) :- rdf_has(Next, Property, Node).

% -- changes -----------------------------------------------------------------------------------------------------------

rdf_assert(Subject, Property, Value) :- request(rdf_assert(Subject, Property, Value, user), _).
rdf_assert(Subject, Property, Value, Source) :-
    ( nonvar(Source), Source = Graph:_ -> true ; Graph = Source ),
    must_be(atom, Graph),
    request(rdf_assert(Subject, Property, Value, Graph), _).

rdf_retractall(Subject, Property, Value) :- request(rdf_retractall(Subject, Property, Value, _), _).
rdf_retractall(Subject, Property, Value, Source) :-
    ( nonvar(Source), Source = Graph:_ -> true ; Graph = Source ),
    request(rdf_retractall(Subject, Property, Value, Graph), _).

% rdf_update(+Subject, +Property, +Value, +Change): Change is subject(New), predicate(New), object(New) or graph(New).
rdf_update(Subject, Property, Value, Change) :- rdf_update(Subject, Property, Value, _, Change).
rdf_update(Subject, Property, Value, Source, Change) :-
    findall(quad(Subject, Property, Value, Graph), rdf(Subject, Property, Value, Graph), Found),
    ( nonvar(Source), Source = Wanted:_ -> true ; Wanted = Source ),
    forall(( member(quad(Subject, Property, Value, Graph), Found), \+ Graph \= Wanted ),
           ( updated(Change, quad(Subject, Property, Value, Graph), quad(S, P, V, G)),
             rdf_retractall(Subject, Property, Value, Graph),
             rdf_assert(S, P, V, G) )).

updated(subject(New), quad(_, P, V, G), quad(New, P, V, G)).
updated(predicate(New), quad(S, _, V, G), quad(S, New, V, G)).
updated(object(New), quad(S, P, _, G), quad(S, P, New, G)).
updated(graph(New), quad(S, P, V, _), quad(S, P, V, New)).

% The store has no transactions: what a goal has changed before it fails stays.
:- meta_predicate rdf_transaction(0), rdf_transaction(0, +).
rdf_transaction(Goal) :- once(Goal).
rdf_transaction(Goal, _) :- once(Goal).

rdf_load(Source) :- rdf_load(Source, []).
rdf_load(Source, _) :-
    ( is_list(Source) -> Sources = Source ; Sources = [Source] ),
    forall(member(Each, Sources), ( request(owl_parse(Each, true), _), request(prefixes, Pairs), set_default_prefixes(Pairs) )).

rdf_unload(_) :- refuse_store(rdf_unload/1).
rdf_reset_db :- refuse_store(rdf_reset_db/0).

refuse_store(Indicator) :-
    format(string(Sentence), "~q would empty the store of the knowledge base; retract statements with rdf_retractall/3", [Indicator]),
    throw(mindstage_error('InvalidArgumentError', Sentence)).

% -- terms -------------------------------------------------------------------------------------------------------------

rdf_is_resource(Term) :- atom(Term).
rdf_is_literal(Term) :- nonvar(Term), Term = literal(Value), nonvar(Value).
rdf_is_bnode(Term) :- atom(Term), sub_atom(Term, 0, _, _, '_:').
rdf_node(Node) :- rdf_bnode(Node).
rdf_bnode(Node) :- gensym('_:b', Node).
rdf_equal(Resource, Resource).
rdf_global_object(Object, Global) :- expand_prefixes(Object, Global).
rdf_global_term(Term, Global) :- expand_prefixes(Term, Global).
rdf_literal_value(Literal, Value) :- with_rdf_db(rdf_literal_value(Literal, Value)).
rdf_member_property(Property, Index) :- with_rdf_db(rdf_member_property(Property, Index)).
rdf_match_label(How, Search, Label) :- with_rdf_db(rdf_match_label(How, Search, Label)).
lang_equal(One, Other) :- with_rdf_db(lang_equal(One, Other)).
lang_matches(Language, Pattern) :- with_rdf_db(lang_matches(Language, Pattern)).

with_rdf_db(Goal) :- load_rdf_db, rdf_db:Goal.

% rdf_split_url(?Namespace, ?Name, ?Iri): the name begins after the last # or /.
rdf_split_url(Namespace, Name, Iri) :- nonvar(Namespace), nonvar(Name), !,
    resource_text(Namespace, Start),
    atom_concat(Start, Name, Iri).
rdf_split_url(Namespace, Name, Given) :-
    ( nonvar(Given) -> true ; instantiation_error(Given) ),
    resource(Given, Iri),
    findall(End, ( member(Cut, ['#', '/']), sub_atom(Iri, At, 1, _, Cut), End is At + 1 ), Ends),
    (   max_list(Ends, Length) -> true ; Length = 0 ),
    sub_atom(Iri, 0, Length, Rest, Namespace),
    sub_atom(Iri, Length, Rest, 0, Name).

resource_text(Text, Atom) :- text_atom(Text, Atom).

rdf_url_namespace(Iri, Namespace) :- rdf_split_url(Namespace, _, Iri).

% -- classes and properties --------------------------------------------------------------------------------------------

thing('http://www.w3.org/2002/07/owl#Thing').

% rdfs_individual_of(?Individual, ?Class): asserted, inherited and inferred classes; everything is an owl:Thing.
rdfs_individual_of(Given, Class) :- nonvar(Class), !,
    up_to_date,
    resource(Class, C),
    resource(Given, Individual),
    (   class_member(C, Individual)
    *-> true
    ;   atom(Individual), \+ sub_atom(Individual, _, _, _, :),
        answers(rdfs_individual_of(Individual, C))
    ).
rdfs_individual_of(Given, Class) :- nonvar(Given), !,
    up_to_date,
    resource(Given, Individual),
    class_of(Individual, Class).
rdfs_individual_of(Individual, Class) :- answers(rdfs_individual_of(Individual, Class)).

up_to_date :- ( mirrored -> true ; true ).

rdfs_instance_of(Individual, Class) :- rdfs_individual_of(Individual, Class).
rdfs_instance_of(Individual, Class) :-
    nonvar(Class),
    resource(Class, C),
    computed_members(C, Individual),
    \+ rdfs_individual_of(Individual, C).

rdfs_subclass_of(Class, Superclass) :- nonvar(Class), !,
    up_to_date,
    resource(Class, C),
    resource(Superclass, Super),
    (   superclass(C, Super)
    *-> true
    ;   atom(Super), \+ sub_atom(Super, _, _, _, :),
        answers(rdfs_subclass_of(C, Super))
    ).
rdfs_subclass_of(Class, Superclass) :- nonvar(Superclass), !,
    up_to_date,
    resource(Superclass, Super),
    subclass(Super, Class).
rdfs_subclass_of(Class, Superclass) :- answers(rdfs_subclass_of(Class, Superclass)).

% rdfs_subproperty_of(?Sub, ?Super): reflexive and transitive; one end must be bound.
rdfs_subproperty_of(Sub, Super) :- nonvar(Super), !,
    up_to_date,
    resource(Super, P),
    resource(Sub, Q),
    implied_property(P, Q).
rdfs_subproperty_of(Sub, Super) :- nonvar(Sub), !,
    up_to_date,
    resource(Sub, Q),
    superproperty(Q, Super).
rdfs_subproperty_of(_, _) :- instantiation_error(_).

% rdfs_class_property(+Class, ?Property): properties whose domain includes the class.
rdfs_class_property(Class, Property) :-
    resource(Class, C),
    rdf(Property, 'http://www.w3.org/2000/01/rdf-schema#domain', Domain),
    atom(Domain),
    rdfs_subclass_of(C, Domain).

rdfs_label(Resource, Label) :- rdfs_label(Resource, _, Label).

% rdfs_label(?Resource, ?Language, -Label): a label without a language has the language ''.
rdfs_label(Resource, Language, Label) :-
    rdf_has(Resource, 'http://www.w3.org/2000/01/rdf-schema#label', literal(Literal)),
    (   Literal = lang(Found, Label) -> Language = Found
    ;   arg(2, Literal, Label),
        ( var(Language) -> Language = '' ; Language == '' )
    ).

% rdfs_member(?Element, +Collection): of a container or of a list.
rdfs_member(Element, Collection) :-
    (   rdfs_list_to_prolog_list(Collection, List)
    ->  member(Element, List)
    ;   rdf(Collection, Property, Element),
        rdf_member_property(Property, _)
    ).

% rdfs_list_to_prolog_list(+List, -Elements): of an rdf:List; fails if it is none, or has no end.
rdfs_list_to_prolog_list(List, Elements) :-
    resource(List, Node),
    list_elements(Node, [], Elements).

list_elements('http://www.w3.org/1999/02/22-rdf-syntax-ns#nil', _, []) :- !.
list_elements(Node, Seen, [First|Elements]) :-
    \+ memberchk(Node, Seen),
    once(rdf(Node, 'http://www.w3.org/1999/02/22-rdf-syntax-ns#first', First)),
    once(rdf(Node, 'http://www.w3.org/1999/02/22-rdf-syntax-ns#rest', Rest)),
    list_elements(Rest, [Node|Seen], Elements).

% rdfs_assert_list(+Elements, -List): asserts an rdf:List.
rdfs_assert_list([], 'http://www.w3.org/1999/02/22-rdf-syntax-ns#nil').
rdfs_assert_list([First|Elements], Node) :-
    rdfs_assert_list(Elements, Rest),
    rdf_bnode(Node),
    rdf_assert(Node, 'http://www.w3.org/1999/02/22-rdf-syntax-ns#first', First),
    rdf_assert(Node, 'http://www.w3.org/1999/02/22-rdf-syntax-ns#rest', Rest).

% -- computed properties -----------------------------------------------------------------------------------------------

% computables(+Property, -Computables): clause(Property) for the hook above, command(Goal) for a computable:PrologProperty of
% an ontology, whose command is the name of a predicate in a file of the user. No other predicate is called: ontologies are
% not trusted.
:- dynamic mindstage_rdf_mirror:computables_/2.

computables(Property, Computables) :- mindstage_rdf_mirror:computables_(Property, Computables), !.
computables(Property, Computables) :-
    findall(Computable, ( implied_property(Property, Sub), computable_by(Sub, Computable) ), Found),
    list_to_set(Found, Computables),
    assertz(mindstage_rdf_mirror:computables_(Property, Computables)).

computable_by(Property, clause(Property)) :- \+ \+ clause(computable(Property, _, _), _).
computable_by(Property, command(Command)) :- command(Property, Command).

computes(clause(Property), Subject, Value) :- computable(Property, Subject, Value).
computes(command(Command), Subject, Value) :- call(Command, Subject, Value).

% computed_members(+Class, ?Individual): by a computable:PrologClass, whose command has the individual and the class.
computed_members(Class, Individual) :-
    up_to_date,
    subclass(Class, Sub),
    command(Sub, Command),
    call(Command, Individual, Sub).

% command(+Target, -Module:Name): the command of a computable for a property or class.
command(Target, Module:Name) :-
    computable_term(target, TargetProperty),
    rdf(Computable, TargetProperty, Target),
    computable_term(command, CommandProperty),
    rdf(Computable, CommandProperty, literal(type(_, Text))),
    ( atomic_list_concat([Module, Name], ':', Text) -> true ; Name = Text ),
    functor(Head, Name, 2),
    once(( current_module(Module), user_predicate(Module:Head) )).

computable_term(Name, Property) :-
    member(Start, ['http://knowrob.org/kb/computable.owl#', 'http://ias.cs.tum.edu/kb/computable.owl#']),
    atom_concat(Start, Name, Property).

% user_predicate(:Head): it is defined in a file that is neither of SWI-Prolog nor of Mindstage.
user_predicate(Head) :-
    predicate_property(Head, file(File)),
    \+ predicate_property(Head, imported_from(_)),
    \+ internal_file(File).

internal_file(File) :-
    (   current_prolog_flag(home, Home) ; module_property(mindstage_semweb, file(Own)), file_directory_name(Own, Home) ),
    sub_atom(File, 0, _, _, Home), !.
