% What is allowed in which cupboard: classes, what they promise, and small classes of our own.

:- module(cupboard_classes, [kept_cold/1]).
:- use_module(library('semweb/owl')).
:- use_module(library('knowrob/owl')).
:- use_module(library('knowrob/computable')).

:- rdf_register_prefix(home, 'http://example.org/home.owl#').
:- rdf_meta kept_cold(r), names(t, r, t, -).

:- multifile mindstage_semweb:computable/3.
mindstage_semweb:computable('http://example.org/home.owl#coldIn', Thing, Fridge) :-
    rdf_equal(kitchen:fridge, Fridge), in_ContGeneric(Thing, Fridge).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).
kept_cold(Class) :- owl_subclass_of(Class, knowrob:'Perishable').

:- begin_tests(ontology).
:- use_module(library('semweb/owl_parser')).
:- prolog_load_context(directory, Folder),
   atom_concat(Folder, '/home.ttl', File),
   owl_parser:owl_parse(File),
   owl_parse(File, false), owl_parse(File, complete, false), owl_parse(File, complete, strict, false),
   load_owl(File), load_owl(File, [namespace(home, 'http://example.org/home.owl#')]),
   tripledb_load(File), tripledb_load(File, [namespace(home, 'http://example.org/home.owl#')]),
   rdf_load(File), rdf_load([File], [silent(true)]).

test(handles, true(Number == 33)) :- aggregate_all(count, owl_individual_of(_, knowrob:'Handle'), Number).
test(handles_by_rdfs, true(Number == 33)) :- aggregate_all(count, rdfs_individual_of(_, knowrob:'Handle'), Number).
test(milk_is_an_instance, [nondet]) :-
    rdfs_instance_of(kitchen:milk_carton_1, knowrob:'CowsMilk'), owl_instance_of(kitchen:milk_carton_1, knowrob:'Drink').
test(milk_spoils, [nondet]) :- kept_cold(knowrob:'CowsMilk').
test(a_teapot_is_a_vessel, all(Name == ['Teapot', 'Pot', 'Vessel'])) :-
    rdfs_subclass_of(home:'Teapot', Class), sub_atom(Class, 0, _, _, 'http://example.org/home.owl#'), short(Class, Name).
test(the_class_right_above, all(Name == ['Pot'])) :- owl_direct_subclass_of(home:'Teapot', Class), atom(Class),
    sub_atom(Class, 0, _, _, 'http://example.org/home.owl#'), short(Class, Name).
test(the_nearest_common_class, true(Name == 'Vessel')) :-
    rdf_common_ancestor([home:'Teapot', home:'Glass'], Class), short(Class, Name).
test(subproperties, [nondet]) :- rdfs_subproperty_of(home:standsOn, home:touches).
test(properties_of_a_class, [nondet]) :- rdfs_class_property(home:'Teapot', home:volume).
test(labels, all(Label == ['the good teapot'])) :- rdfs_label(home:best, Label).
test(labels_by_language, all(Label == ['the good teapot'])) :- rdfs_label(home:best, en, Label).
test(a_shelf_is_a_list, true(Names == [best, spare])) :-
    rdf_has(home:shelf, home:holds, List), rdfs_list_to_prolog_list(List, Things), maplist(short, Things, Names).
test(members_of_the_shelf, all(Name == [best, spare])) :-
    rdf_has(home:shelf, home:holds, List), rdfs_member(Thing, List), short(Thing, Name).
test(a_list_is_asserted, true(Names == [spare, best])) :-
    rdfs_assert_list([home:spare, home:best], List), rdfs_list_to_prolog_list(List, Things), maplist(short, Things, Names).
test(what_stands_in_what_stands_in_the_cupboard, all(Name == [tray, cupboard])) :-
    owl_has(home:best, home:inside, Place), short(Place, Name).
test(one_thing_with_two_names, all(Name == [best])) :- owl_same_as(home:favourite, Thing), short(Thing, Name).
test(pots_are_no_glasses, [nondet]) :- owl_disjoint_with(home:'Teapot', home:'Glass').
test(every_teapot_has_a_lid, all(Name == ['Lid'])) :- class_properties(home:'Teapot', home:part, Part), short(Part, Name).
test(some_part_is_a_lid, all(Name == ['Lid'])) :- class_properties_some(home:'Teapot', home:part, Part), short(Part, Name).
test(all_that_is_in_it_is_tea, all(Name == ['Tea'])) :- class_properties_all(home:'Teapot', home:content, What), short(What, Name).
test(it_is_made_of_clay, all(Name == [clay])) :- class_properties_value(home:'Pot', home:material, What), short(What, Name).
test(the_thesis_writes_them_so, [nondet, true(Name == 'Lid')]) :-
    owl_class_properties(home:'Teapot', home:part, Part), short(Part, Name).
test(restrictions_are_terms, [nondet, true(Name == 'Lid')]) :-
    owl_restriction_on(home:'Teapot', restriction(_, some_values_from(Part))), short(Part, Name).
test(nodes_are_restrictions, [nondet, true(Name == 'Tea')]) :-
    rdf(home:'Teapot', rdfs:subClassOf, Node), rdf_is_bnode(Node), owl_restriction(Node, restriction(_, all_values_from(What))),
    short(What, Name).
test(a_class_is_described_by_itself, true(Name == 'Pot')) :- owl_description(home:'Pot', class(Class)), short(Class, Name).
test(who_is_a_pot_or_a_glass, true(Names == [best, spare, tumbler])) :-
    findall(Name, ( owl_satisfies(union_of([home:'Pot', home:'Glass']), Thing), short(Thing, Name) ), Found),
    sort(Found, Names).
test(a_new_restriction, true(Name == handle)) :-
    create_restr(home:'Glass', home:part, home:handle, owl:hasValue, user, _),
    class_properties_value(home:'Glass', home:part, Part), short(Part, Name).
test(new_individuals, [nondet]) :-
    rdf_instance_from_class(home:'Glass', One), rdf_instance_from_class(home:'Glass', user, Other), One \== Other,
    owl_individual_of(One, home:'Vessel'), rdf_retractall(One, _, _), rdf_retractall(Other, _, _).
test(unused_names) :- rdf_unique_id(home:'Glass', Name), \+ rdf(Name, _, _).
test(a_computed_property, [nondet]) :- rdf_has(kitchen:milk_carton_1, home:coldIn, kitchen:fridge).
test(only_computed, [nondet]) :- rdfs_computable_triple(home:coldIn, kitchen:milk_carton_1, kitchen:fridge).
test(no_class_is_computed, fail) :- rdfs_computable_instance_of(_, 'http://example.org/home.owl#Glass').
test(texts_of_literals, true(Text == '1.2')) :- rdf_has(home:best, home:volume, Value), strip_literal_type(Value, Text).
test(names_without_namespace, true(Name == fridge)) :- remove_namespace(kitchen:fridge, Name).

:- end_tests(ontology).
