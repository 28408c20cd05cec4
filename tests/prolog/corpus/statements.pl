% Labels for a cupboard: notes about things are statements of our own, which are written, corrected and removed.

:- module(cupboard_notes, [note/2, kinds_of_change/0]).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('semweb/rdfs')).

:- rdf_db:rdf_register_ns(notes, 'http://example.org/notes.owl#', [keep(true)]).
:- rdf_register_ns(old_notes, 'http://example.org/old.owl#').
:- rdf_register_prefix(shelf, 'http://example.org/shelf.owl#').
:- rdf_register_prefix(shelf, 'http://example.org/ignored.owl#', [keep(true)]).

:- rdf_meta note(r, ?), in_language(+, r, -).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).

note(Thing, Text) :- rdf(Thing, notes:says, literal(type(xsd:string, Text))).

kinds_of_change :- rdf_current_predicate(knowrob:child).

in_language(Wanted, Thing, Label) :- rdfs_label(Thing, Language, Label), lang_matches(Language, Wanted).

:- begin_tests(statements).

test(a_door_has_one_handle, all(Name == [fridge_door_handle])) :-
    rdf(kitchen:fridge_door, knowrob:child, Handle), short(Handle, Name).
test(the_graph_of_an_own_statement_is_user, true(Graph == user)) :-
    rdf_assert(notes:a, notes:says, literal(hello)),
    rdf(notes:a, notes:says, _, Graph).
test(an_assertion_into_a_graph_stays_there, true(Found == [shopping])) :-
    rdf_assert(notes:b, notes:says, literal('buy milk'), shopping),
    findall(Graph, rdf(notes:b, notes:says, _, Graph), Found).
test(texts_without_a_type_are_strings, [nondet, true(Text == hello)]) :- note(notes:a, Text).
test(inverse_properties_are_followed, [nondet]) :-
    rdf_has(kitchen:fridge_door_handle, knowrob:describedInMap, kitchen:kitchen).
test(the_asserted_property_is_told, [nondet, true(Name == child)]) :-
    rdf_has(kitchen:fridge_door, knowrob:child, kitchen:fridge_door_handle, Asserted), short(Asserted, Name).
test(parts_of_parts_are_reached, true(Names == [fridge_door, fridge_door_handle])) :-
    findall(Name, ( rdf_reachable(kitchen:fridge_door, knowrob:child, Part), short(Part, Name) ), Names).
test(one_step_reaches_the_handle, true(Steps == [0, 1])) :-
    findall(N, rdf_reachable(kitchen:fridge_door, knowrob:child, _, 1, N), Steps).
test(the_property_may_come_first, [nondet]) :- rdf_triple(knowrob:child, kitchen:fridge_door, kitchen:fridge_door_handle).
test(owl_has_its_own_order, [nondet]) :- owl_triple(kitchen:fridge_door, knowrob:child, kitchen:fridge_door_handle).
test(a_note_is_corrected, true(Text == goodbye)) :-
    rdf_update(notes:a, notes:says, literal(type(xsd:string, hello)), object(literal(goodbye))),
    note(notes:a, Text).
test(a_note_of_a_graph_moves_to_another_thing, true(Text == 'buy milk')) :-
    rdf_update(notes:b, notes:says, literal(type(xsd:string, 'buy milk')), shopping, subject(notes:c)),
    \+ note(notes:b, _),
    note(notes:c, Text).
test(changes_in_one_goal, true(Text == twice)) :-
    rdf_transaction(( rdf_retractall(notes:a, notes:says, _), rdf_assert(notes:a, notes:says, literal(twice)) )),
    rdf_transaction(note(notes:a, Text), reading).
test(removed_from_one_graph_only) :-
    rdf_assert(notes:d, notes:says, literal(kept)),
    rdf_assert(notes:d, notes:says, literal(gone), draft),
    rdf_retractall(notes:d, notes:says, _, draft),
    findall(Text, note(notes:d, Text), [kept]).
test(subjects_and_resources, [nondet]) :- rdf_subject(kitchen:fridge), rdf_resource(knowrob:'Refrigerator').
test(properties_in_use) :- once(kinds_of_change).
test(graphs, [nondet]) :- rdf_graph(user).
test(sizes, [nondet, true(Number > 5000)]) :- rdf_statistics(triples(Number)).
test(the_store_counts_its_changes, true(integer(Generation))) :- rdf_generation(Generation).

test(what_is_a_resource) :- rdf_is_resource('http://example.org/notes.owl#a'), \+ rdf_is_resource(literal(a)).
test(what_is_a_literal) :- rdf_is_literal(literal(a)), \+ rdf_is_literal(a).
test(values_of_literals, true(Value == 12)) :-
    rdf_equal(literal(type(xsd:integer, '12')), Literal), rdf_literal_value(Literal, Value).
test(nodes_without_names) :- rdf_bnode(Node), rdf_is_bnode(Node), rdf_node(Other), Other \== Node.
test(prefixes_are_expanded, true(Iri == 'http://example.org/notes.owl#a')) :- rdf_equal(notes:a, Iri).
test(names_are_joined, true(Iri == 'http://example.org/shelf.owl#top')) :- rdf_global_id(shelf:top, Iri).
test(objects_and_terms_are_expanded, true(One-Other == 'http://example.org/shelf.owl#a'-on('http://example.org/old.owl#b'))) :-
    rdf_global_object(shelf:a, One), rdf_global_term(on(old_notes:b), Other).
test(names_are_split, true(Space-Name == 'http://example.org/shelf.owl#'-top)) :-
    rdf_split_url(Space, Name, 'http://example.org/shelf.owl#top').
test(namespaces, true(Space == 'http://example.org/shelf.owl#')) :-
    rdf_url_namespace('http://example.org/shelf.owl#top', Space).
test(registered_prefixes, [nondet]) :-
    rdf_current_ns(old_notes, 'http://example.org/old.owl#'), rdf_current_prefix(shelf, 'http://example.org/shelf.owl#').
test(members_of_containers_are_numbered, true(Number == 3)) :-
    rdf_equal(rdf:'_3', Property), rdf_member_property(Property, Number).
test(labels_are_searched) :- rdf_match_label(word, milk, 'a pint of milk'), \+ rdf_match_label(prefix, milk, 'a pint of milk').
test(languages) :- lang_equal('en-GB', 'en-gb'), \+ lang_equal(en, de).
test(labels_in_english, [nondet, true(Label == 'cow\'s milk')]) :- in_language(en, knowrob:'CowsMilk', Label).
test(the_store_is_never_emptied, throws(mindstage_error('InvalidArgumentError', _))) :- rdf_reset_db.
test(a_source_is_not_unloaded, throws(mindstage_error('InvalidArgumentError', _))) :- rdf_unload('kitchen.owl').

:- end_tests(statements).
