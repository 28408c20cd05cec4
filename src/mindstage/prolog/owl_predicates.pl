% OWL predicates named like those of ClioPatria's owl.pl, of its parser, and of KnowRob's knowrob_owl and util.
%
% A class expression is a class, union_of(List), intersection_of(List), one_of(List), complement_of(Class), a literal, or
% restriction(Property, Condition) with some_values_from(C), all_values_from(C), has_value(V) or cardinality(Min, Max).

:- module(mindstage_owl,
          [ owl_has/3, owl_individual_of/2, owl_instance_of/2, owl_subclass_of/2, owl_direct_subclass_of/2,
            owl_restriction_on/2, owl_restriction/2, owl_description/2, owl_satisfies/2, owl_same_as/2, owl_disjoint_with/2,
            class_properties/3, class_properties_some/3, class_properties_all/3, class_properties_value/3,
            rdf_instance_from_class/2, rdf_instance_from_class/3, rdf_unique_id/2, create_restr/6,
            rdf_common_ancestor/2, rdfs_computable_triple/3, rdfs_computable_instance_of/2,
            owl_parse/1, owl_parse/2, owl_parse/3, owl_parse/4, load_owl/1, load_owl/2, tripledb_load/1, tripledb_load/2,
            strip_literal_type/2, remove_namespace/2 ]).
:- use_module(prefixes).
:- use_module(questions).
:- use_module(rdf_mirror).
:- use_module(semweb).
:- use_module(user_files).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(solution_sequences)).

:- rdf_meta
    owl_has(r, r, o), owl_individual_of(r, r), owl_instance_of(r, r), owl_subclass_of(r, r), owl_direct_subclass_of(r, r),
    owl_restriction_on(r, t), owl_restriction(r, t), owl_description(r, t), owl_satisfies(t, r), owl_same_as(r, r),
    owl_disjoint_with(r, r), class_properties(r, r, t), class_properties_some(r, r, t), class_properties_all(r, r, t),
    class_properties_value(r, r, t), rdf_instance_from_class(r, -), rdf_instance_from_class(r, +, -), rdf_unique_id(r, -),
    create_restr(r, r, t, r, +, -), rdf_common_ancestor(t, r), rdfs_computable_triple(r, r, t),
    rdfs_computable_instance_of(r, r), remove_namespace(r, -).

% -- statements and classes --------------------------------------------------------------------------------------------

% owl_has(?Subject, ?Property, ?Value): as rdf_has/3, and along transitive properties and by hasValue restrictions.
owl_has(Subject, Property, Value) :- var(Property), !, rdf_has(Subject, Property, Value).
owl_has(Subject, Property, Value) :-
    expand_prefixes(has(Subject, Property, Value), has(S, P, V)),
    distinct(S-V, owl_has_(S, P, V)).

owl_has_(S, P, V) :- rdf_has(S, P, V).
owl_has_(S, P, V) :-
    rdfs_subproperty_of(Transitive, P),
    once(rdf(Transitive, rdf:type, owl:'TransitiveProperty')),
    (   nonvar(S) -> true
    ;   nonvar(V) -> true
    ;   distinct(S, rdf_has(S, Transitive, _))
    ),
    rdf_reachable(S, Transitive, V, inf, Steps),
    Steps > 1.
owl_has_(S, P, V) :-
    nonvar(S),
    rdfs_individual_of(S, Class),
    direct_restriction(Class, P, has_value(V)).

owl_individual_of(Individual, Class) :- rdfs_individual_of(Individual, Class).
owl_instance_of(Individual, Class) :- rdfs_instance_of(Individual, Class).
owl_subclass_of(Class, Superclass) :- rdfs_subclass_of(Class, Superclass).

% owl_direct_subclass_of(?Class, ?Superclass): asserted, between named classes or to a class expression (a blank node).
owl_direct_subclass_of(Class, Superclass) :- rdf_has(Class, rdfs:subClassOf, Superclass).

owl_same_as(One, Other) :- rdf_has(One, owl:sameAs, Other).
owl_same_as(One, Other) :- rdf_has(Other, owl:sameAs, One), \+ rdf_has(One, owl:sameAs, Other).

owl_disjoint_with(One, Other) :- distinct(One-Other, ( disjoint(One, Other) ; disjoint(Other, One) )).

disjoint(One, Other) :-
    rdf_has(First, owl:disjointWith, Second),
    rdfs_subclass_of(One, First),
    rdfs_subclass_of(Other, Second).

% -- class expressions -------------------------------------------------------------------------------------------------

% owl_restriction_on(?Class, ?Restriction): restrictions on all members, the nearest first; inherited ones are included.
owl_restriction_on(Class, Restriction) :-
    restricted_class(Class, C),
    class_restriction(C, Restriction).

% restricted_class(?Given, -Class): a class that may have restrictions.
restricted_class(Given, Class) :- nonvar(Given), !, expand_prefixes(Given, Class).
restricted_class(Class, Class) :- subclass('http://www.w3.org/2002/07/owl#Thing', Class).

% owl_restriction(+Node, -Restriction): of a node that is an owl:Restriction.
owl_restriction(Node, restriction(Property, Condition)) :-
    owl_description(Node, restriction(Property, Condition)).

% owl_description(+Node, -Description): class(Class) for a named class, otherwise its expression.
owl_description(Given, Description) :-
    expand_prefixes(Given, Node),
    must_be(atom, Node),
    request(owl_description(Node), Found),
    Found \== none,
    ( atom(Found) -> Description = class(Found) ; Description = Found ).

% owl_satisfies(+Description, ?Resource): a class or individual_of(Class) as well. As in ClioPatria, class(C) describes the
% subclasses of C, and all_values_from(C) its individuals.
owl_satisfies(Given, GivenResource) :-
    expand_prefixes(Given, Description),
    expand_prefixes(GivenResource, Resource),
    satisfies(Description, Resource).

satisfies('http://www.w3.org/2000/01/rdf-schema#Resource', Resource) :- !,
    ( var(Resource) -> rdf_subject(Resource) ; true ).
satisfies(class(Class), Resource) :- !,
    (   Class == 'http://www.w3.org/2000/01/rdf-schema#Resource' -> true
    ;   nonvar(Resource), Resource = individual_of(_) -> fail
    ;   rdfs_subclass_of(Resource, Class)
    ).
satisfies(union_of(Descriptions), Resource) :- !, member(Each, Descriptions), satisfies(Each, Resource).
satisfies(intersection_of(Descriptions), Resource) :- !,
    Descriptions = [First|Rest],
    satisfies(First, Resource),
    forall(member(Each, Rest), satisfies(Each, Resource)).
satisfies(complement_of(Description), Resource) :- !,
    ( var(Resource) -> rdf_subject(Resource) ; atom(Resource) ),
    \+ satisfies(Description, Resource).
satisfies(one_of(Resources), Resource) :- !, member(Resource, Resources).
satisfies(all_values_from(Class), Resource) :- !, is_of(Resource, Class).
satisfies(some_values_from(_), _) :- !.
satisfies(has_value(Value), Value) :- !.
satisfies(restriction(Property, Condition), Resource) :- !,
    ( var(Resource) -> distinct(Resource, has_value(Property, Resource, _)) ; true ),
    findall(Value, has_value(Property, Resource, Value), Values),
    fulfills(Condition, Values).
satisfies(Class, Resource) :- atom(Class), is_of(Resource, Class).

has_value(inverse_of(Property), Resource, Value) :- !, owl_has(Value, Property, Resource).
has_value(Property, Resource, Value) :- owl_has(Resource, Property, Value).

is_of(Resource, Class) :-
    (   nonvar(Resource), Resource = individual_of(Own)
    ->  rdfs_subclass_of(Own, Class)
    ;   owl_individual_of(Resource, Class)
    ).

fulfills(has_value(Value), Values) :- memberchk(Value, Values).
fulfills(some_values_from(Class), Values) :- once(( member(Value, Values), satisfies(Class, Value) )).
fulfills(all_values_from(Class), Values) :- forall(member(Value, Values), satisfies(Class, Value)).
fulfills(cardinality(Least, Most), Values) :-
    sort(Values, Distinct),
    length(Distinct, Number),
    Number >= Least,
    ( Most == inf -> true ; Number =< Most ).

% class_properties(?Class, ?Property, ?Value): what some_values_from and has_value restrictions require, inherited or not.
% Property is inverse_of(P) for restrictions on the inverse of P.
class_properties(Class, Property, Value) :- distinct(Class-Property-Value, class_property(Class, Property, Value)).

class_property(Class, Property, Value) :- class_properties_some(Class, Property, Value).
class_property(Class, Property, Value) :- class_properties_value(Class, Property, Value).

class_properties_some(Class, Property, Value) :- class_property(some_values_from(Value), Class, Property, Value).
class_properties_all(Class, Property, Value) :- class_property(all_values_from(Value), Class, Property, Value).
class_properties_value(Class, Property, Value) :- class_property(has_value(Value), Class, Property, Value).

class_property(Condition, Class, Property, Given) :-
    expand_prefixes(Given, Value),
    Condition =.. [Kind, _],
    Wanted =.. [Kind, Value],
    expand_prefixes(Property, P),
    restricted_class(Class, C),
    ( var(Class) -> Class = C ; true ),
    distinct(P-Value, direct_restriction(C, P, Wanted)).

% direct_restriction(+Class, ?Property, ?Condition): of the property or of a subproperty, inherited or not.
direct_restriction(Class, Property, Condition) :-
    class_restriction(Class, restriction(Restricted, Condition)),
    restricts(Restricted, Property).

% restricts(+Restricted, ?Property): an unbound property is the restricted one, as written; inverse_of(P) has those of the
% inverses of P and of its subproperties.
restricts(Restricted, Property) :- var(Property), !, Property = Restricted.
restricts(inverse_of(Restricted), inverse_of(Property)) :- !, restricts(Restricted, Property).
restricts(Restricted, Property) :- atom(Restricted), atom(Property), once(superproperty(Restricted, Property)).

class_restriction(Class, Restriction) :-
    ( mirrored -> true ; true ),
    restriction_of(Class, Restriction).

% -- new individuals ---------------------------------------------------------------------------------------------------

% rdf_instance_from_class(+Class, -Individual): asserts an individual with a new name.
rdf_instance_from_class(Class, Individual) :- rdf_instance_from_class(Class, user, Individual).

rdf_instance_from_class(Given, Graph, Individual) :-
    expand_prefixes(Given, Name),
    (   sub_atom(Name, _, _, _, :) -> Class = Name ; atom_concat('http://knowrob.org/kb/knowrob.owl#', Name, Class) ),
    rdf_unique_id(Class, Individual),
    ( var(Graph) -> Graph = user ; true ),
    rdf_assert(Individual, rdf:type, Class, Graph).

% rdf_unique_id(+Class, -Name): a name that no statement has.
rdf_unique_id(Given, Unique) :-
    expand_prefixes(Given, Class),
    repeat,
    random_between(0, 0xffffffff, Number),
    format(atom(Unique), "~w_~|~`0t~16r~8+", [Class, Number]),
    \+ rdf(Unique, _, _),
    \+ rdf(_, _, Unique), !.

% create_restr(+Class, +Property, +Value, +Kind, +Graph, -Node): asserts a restriction unless the class has such a property.
create_restr(Class, Property, Value, Kind, Graph, Node) :-
    \+ class_properties(Class, Property, Value),
    rdf_bnode(Node),
    rdf_assert(Node, rdf:type, owl:'Restriction', Graph),
    rdf_assert(Node, owl:onProperty, Property, Graph),
    rdf_assert(Node, Kind, Value, Graph),
    rdf_assert(Class, rdfs:subClassOf, Node, Graph).

% rdf_common_ancestor(+Classes, -Ancestor): the nearest class above all of them.
rdf_common_ancestor([First|Rest], Ancestor) :-
    rdfs_subclass_of(First, Ancestor),
    forall(member(Class, Rest), rdfs_subclass_of(Class, Ancestor)), !.

rdfs_computable_triple(Property, Subject, Value) :- rdf_triple(Property, Subject, Value), \+ rdf(Subject, Property, Value).
rdfs_computable_instance_of(Individual, Class) :-
    mindstage_semweb:computed_members(Class, Individual).

% -- ontologies --------------------------------------------------------------------------------------------------------

% owl_parse(+Source): loads a file, a folder of packages, or package://Name/File, with its imports; nothing is fetched. While
% a file of rules is loaded, a source that cannot be read is a warning, as in KnowRob.
owl_parse(Source) :- owl_parse(Source, true).
% owl_parse(+Source, +Imports), owl_parse(+Source, +LoadMode, +Imports) and owl_parse(+Source, +LoadMode, +ParseMode, +Imports):
% Imports is true or false; the modes of Thea have no meaning here.
owl_parse(Source, _, Imports) :- owl_parse(Source, Imports).
owl_parse(Source, _, _, Imports) :- owl_parse(Source, Imports).
owl_parse(Source, Imports) :-
    ( Imports == false -> Follow = false ; Follow = true ),
    catch(parse(Source, Follow), mindstage_error(Kind, Sentence), unread(Source, Kind, Sentence)).

% load_owl(+Source, +Options), tripledb_load(+Source, +Options): of KnowRob 2; namespace(Prefix, Iri) registers a prefix.
load_owl(Source) :- owl_parse(Source).
load_owl(Source, Options) :-
    forall(member(namespace(Prefix, Start), Options), rdf_register_prefix(Prefix, Start)),
    owl_parse(Source).
tripledb_load(Source) :- load_owl(Source).
tripledb_load(Source, Options) :- load_owl(Source, Options).

parse(Source, Follow) :-
    text_to_atom(Source, Given),
    local_source(Given, Path),
    request(owl_parse(Path, Follow), _),
    request(prefixes, Pairs),
    set_default_prefixes(Pairs).

text_to_atom(Text, Atom) :- ( atomic(Text) -> format(atom(Atom), "~w", [Text]) ; type_error(atomic, Text) ).

% local_source(+Source, -File): a package beside the file that is being loaded comes first.
local_source(Source, File) :-
    atom_concat('package://', Rest, Source),
    atomic_list_concat([Package|Parts], /, Rest),
    rospack_package_path(Package, Folder),
    atomic_list_concat([Folder|Parts], /, File),
    exists_file(File), !.
local_source(Source, Source).

unread(Source, 'SourceParseError', Sentence) :- prolog_load_context(source, _), !,
    print_message(warning, mindstage_source_not_loaded(Source, Sentence)).
unread(_, Kind, Sentence) :- throw(mindstage_error(Kind, Sentence)).

% -- texts -------------------------------------------------------------------------------------------------------------

% strip_literal_type(+Value, -Text): the text of a literal; another value is itself.
strip_literal_type(Value, Text) :- nonvar(Value), Value = literal(Literal), !,
    ( compound(Literal), arg(2, Literal, Found) -> Text = Found ; Text = Literal ).
strip_literal_type(Value, Value).

% remove_namespace(+Iri, -Name)
remove_namespace(Iri, Name) :- rdf_split_url(_, Name, Iri).
