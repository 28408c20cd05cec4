% The map is spawned and shown, as in the thesis of 2019.

:- module(show_kitchen, [begin/1]).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).
begin(Map) :- spawn_semantic_map(Map), \+ failed_item(_, _, _).

:- begin_tests(spawning).

test(parts_of_the_map) :-
    map_instance(Map),
    spawn_models(Map, [fridge, fridge_door]),
    spawn_constraints(Map, [fridge_door_hinge]),
    spawn_relations(Map, [fridge], [fridge_door]),
    \+ failed_item(_, _, _).
test(the_fridge_is_there_already, fail) :- spawn_model(fridge, 'Refrigerator', 0, 0, 0, 0, 0, 0, 1).
test(a_cup_is_put_onto_the_table) :- spawn_model(cup_of_mine, 'Cup', 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0).
test(no_hinge_between_things_that_are_not_there, fail) :-
    length(Zeros, 19), maplist(=(0), Zeros), spawn_constraint([nobody, nothing, 0, 0, 0, 0, 0, 0, 1|Zeros]).
test(a_cup_in_the_hand_of_the_fridge) :- attach_model_to_parent(fridge, cup_of_mine).
test(a_cup_is_attached_in_one_way_only, throws(mindstage_error('AttachmentError', _))) :- attach_model(cup_of_mine, fridge).
test(the_rest_fails_for_what_is_there, fail) :- spawn_semantic_map(_).
test(what_failed_is_listed) :-
    once(( failed_item(body, fridge, Reason), sub_atom(Reason, _, _, _, taken) )), with_output_to(string(Text), debug_failed_items),
    once(sub_string(Text, _, _, _, "fridge")).

test(one_thing) :- highlight(fridge).
test(in_red) :- highlight([fridge, oven], red).
test(by_text) :- highlight_models(["fridge", "oven"]).
test(all_fridges) :- highlight_everything_that_is(_, knowrob:'Refrigerator').
test(where_milk_belongs) :- highlight_likely_storage_place(_, knowrob:'CowsMilk').
test(where_to_grasp) :- highlight_handle_of(_, fridge_door).
test(the_handle_is_answered, all(Name == [fridge_door_handle])) :- highlight_handle_of(_, fridge_door, Handle), short(Handle, Name).
test(what_to_bake_with) :- highlight_device_for_action(_, knowrob:'BakingFood').
test(its_class, all(Name == ['HeatSource'])) :- highlight_device_for_action(_, knowrob:'BakingFood', Class), short(Class, Name).
test(no_robot_is_there, fail) :- highlight_everything_that_is(_, knowrob:'Robot').
test(nothing_shines) :- unhighlight.

test(cups_of_the_map, [nondet]) :- get_subclass_in_map(_, knowrob:'Refrigerator', kitchen:fridge).
test(the_class_of_place_for_milk, [nondet, true(Name == 'Refrigerator')]) :-
    likely_storage_place(knowrob:'CowsMilk', Class), short(Class, Name).
test(the_place_for_milk, [nondet, true(Name == fridge)]) :-
    likely_storage_place_in_environment(_, knowrob:'CowsMilk', Place), short(Place, Name).
test(counts, [nondet, true(Individuals =:= Objects + Constraints)]) :-
    analyse_semantic_map(_, _, Individuals, Objects, Constraints, Relations), Relations > 0.
test(a_map_is_itself) :- once(identical_maps(kitchen:kitchen, kitchen:kitchen)).
test(a_map_is_nearly_itself) :- once(identical_maps(kitchen:kitchen, kitchen:kitchen, 0.001)).

:- end_tests(spawning).
