% The same kitchen in the language of KnowRob 2 and in the descriptions of openEASE.

:- module(kitchen_language, [cold_drinks/1]).
:- use_module(library('lang/terms/is_a')).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).
cold_drinks(Drinks) :- findall(Drink, ask([has_type(Drink, knowrob:'Drink'), is_inside_of(Drink, fridge)]), Drinks).

:- begin_tests(language).

test(cold_drinks, [nondet]) :- cold_drinks(Drinks), maplist(short, Drinks, Names), memberchk(milk_carton_1, Names).
test(calls, [nondet]) :- kb_call((has_type(Milk, knowrob:'CowsMilk'), is_at(Milk, _))).
test(where_it_is, [nondet, true(Position == [-1.567, 1.5, 1.6])]) :- is_at(milk_carton_1, [map, Position, _]).
test(what_it_weighs, [nondet, true(Mass == 1.05)]) :- triple(milk_carton_1, knowrob:mass, Mass).
test(kinds, [nondet]) :-
    instance_of(milk_carton_1, knowrob:'CowsMilk'), subclass_of(knowrob:'CowsMilk', knowrob:'Drink'),
    is_a(milk_carton_1, knowrob:'Drink').
test(individuals_and_classes) :- is_individual(kitchen:fridge), is_class(knowrob:'Refrigerator'), \+ is_class(kitchen:fridge).
test(the_door_has_a_part, all(Name == [fridge_door_handle])) :- has_part(fridge_door, Part), short(Part, Name).
test(the_basil_stands_in_the_window, all(Name == [window_sill])) :- is_supported_by(basil_pot_1, Sill), short(Sill, Name).

test(statements_hold_for_ever, [nondet, true(Begin-End == 0.0-inf)]) :-
    kb_call(has_type(kitchen:fridge, knowrob:'Refrigerator') during [Begin, End]).
test(since_and_until, [nondet]) :-
    ask(has_type(kitchen:fridge, knowrob:'Refrigerator') since 10.0), ask(has_type(kitchen:fridge, knowrob:'Refrigerator') until 20.0).

test(a_cup_is_told_and_forgotten, [nondet, true(Mass == 0.25)]) :-
    tell([new_iri(Cup, knowrob:'Cup'), has_type(Cup, knowrob:'Cup'), triple(Cup, knowrob:mass, 0.25)]),
    triple(Cup, knowrob:mass, Mass),
    forget(triple(Cup, knowrob:mass, _)), \+ triple(Cup, knowrob:mass, _).
test(a_new_name_is_not_in_use) :- new_iri(Name, knowrob:'Cup'), \+ rdf(Name, _, _).
test(likewise_in_projection) :-
    kb_project(has_type(kitchen:best_cup, knowrob:'Cup')), once(has_type(kitchen:best_cup, knowrob:'Cup')),
    kb_unproject(has_type(kitchen:best_cup, knowrob:'Cup')), \+ has_type(kitchen:best_cup, knowrob:'Cup').
test(as_written_in_2018, [nondet, true(Mass == 0.3)]) :-
    kb_create(knowrob:'Cup', Cup), kb_assert(Cup, knowrob:mass, 0.3),
    kb_type_of(Cup, knowrob:'Cup'), kb_triple(Cup, knowrob:mass, Mass), kb_retract(Cup, knowrob:mass, _).
test(with_options, fail) :-
    kb_create(knowrob:'Cup', Cup, [graph(belief_state)]), kb_assert(Cup, knowrob:mass, 0.3, [graph(belief_state)]),
    kb_retract(Cup, knowrob:mass, _, [graph(belief_state)]), kb_triple(Cup, knowrob:mass, _).

test(milk_in_the_fridge, all(Name == [milk_carton_1, milk_carton_2])) :-
    entity(Milk, [an, object, [type, milk_carton], [inside, [a, refrigerator]]]), short(Milk, Name).
test(shown) :- spawn_semantic_map(_), show([an, object, [type, milk]]), show(oven, red).
test(an_arrow_is_painted_and_removed) :-
    marker(arrow(here), Arrow), marker_pose(Arrow, [map, [1, 2, 3], [0, 0, 0, 1]]), marker_scale(Arrow, [0.5, 0.1, 0.1]),
    marker_color(Arrow, [1, 0, 0]), marker_remove(Arrow), \+ marker_remove(Arrow).
test(why_the_handle, true(sub_string(Text, _, _, _, "Handle"))) :-
    with_output_to(string(Text), why(handle_of(_, fridge_door, _))).
test(what_is_missing, [nondet]) :- missing(storage_place(knowrob:'Robot', _), Sentence), sub_atom(Sentence, 0, _, _, 'Robot has no').

:- end_tests(language).
