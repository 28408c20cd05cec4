% A robot asks about its kitchen in the terms of KnowRob 1: maps, objects, relations in space, and earlier times.

:- module(kitchen_rules, [place_for/2, opens/2, near/2]).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('knowrob/knowrob')).

:- rdf_meta place_for(r, r), opens(r, ?), near(r, r).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).

place_for(Thing, Place) :- storagePlaceFor(Place, Thing).
opens(Furniture, Motion) :- map_connection_type(Furniture, Front, Motion), rdfs_individual_of(Front, knowrob:'Door').
near(A, B) :- object_distance(A, B, Distance), Distance < 0.7.

:- begin_tests(kitchen).

test(one_map, true(Name == kitchen)) :- map_instance(Map), short(Map, Name).
test(the_fridge_is_in_the_map, [nondet]) :- map_root_object(_, kitchen:fridge).
test(everything_is_in_the_map, [nondet]) :-
    map_root_objects(_, All), length(All, Number), aggregate_all(count, map_root_object(_, _), Number).
test(the_door_has_a_handle, all(Name == [fridge_door_handle])) :- map_child_object(kitchen:fridge_door, Part), short(Part, Name).
test(parts_as_a_list, true(Names == [fridge_door_handle])) :-
    map_child_objects(kitchen:fridge_door, Parts), maplist(short, Parts, Names).
test(what_is_known_of_the_fridge, [nondet, true(Height-Size == 1.4-[0.6, 0.6, 1.4])]) :-
    rdf_equal(kitchen:fridge, Fridge),
    map_object_info([Fridge, _, Pose, Size]), nth1(12, Pose, Height).
test(its_type, [nondet]) :- map_object_type(kitchen:fridge, Type), rdfs_subclass_of(Type, knowrob:'Refrigerator').
test(its_label, fail) :- map_object_label(kitchen:fridge, 'the washing machine').
test(its_size, all(W-D-H == [0.6-0.6-1.4])) :- map_object_dimensions(kitchen:fridge, W, D, H).
test(its_size_in_the_other_order, all(D-W-H == [0.6-0.6-1.4])) :- object_dimensions(kitchen:fridge, D, W, H).
test(it_has_a_hinge, [nondet, true(Motion == 'HingedJoint')]) :- opens(kitchen:fridge, Motion).
test(the_name_of_the_hinge, all(Name == [fridge_door_hinge])) :-
    map_joint_name(kitchen:fridge, kitchen:fridge_door, Joint), short(Joint, Name).

test(where_the_milk_is, [nondet, true(Position == [-1.567, 1.5, 1.6])]) :-
    current_object_pose(kitchen:milk_carton_1, [map, _, Position, _]).
test(where_the_milk_is_now, [nondet, true(Z == 1.6)]) :-
    get_timepoint(Now), object_pose_at_time(kitchen:milk_carton_1, Now, [map, _, [_, _, Z], _]).
test(with_the_quaternion_in_front, [nondet, true(Z == 1.6)]) :-  % the carton is turned by a quarter
    get_timepoint(Now), object_pose_at_time(kitchen:milk_carton_1, Now, [_, _, Z], [W, 0.0, 0.0, _]),
    abs(W - cos(pi / 4)) < 1e-6.
test(an_hour_ago_nothing_was_seen, fail) :-
    get_timepoint('-1h', Then), object_pose_at_time(kitchen:milk_carton_1, Then, _, _).
test(nothing_was_perceived, fail) :- object_detection(kitchen:milk_carton_1, _, _).
test(its_frame, true(Frame == milk_carton_1)) :- object_frame_name(kitchen:milk_carton_1, Frame).
test(grey_if_nothing_is_stated, true(Color == [0.5, 0.5, 0.5, 1.0])) :- object_color(kitchen:fridge, Color).
test(no_mesh_is_named, fail) :- object_mesh_path(kitchen:fridge, _).
test(what_it_affords, [nondet, true(Name == cooling)]) :-
    rdf_assert(kitchen:fridge, knowrob:hasAffordance, kitchen:cooling),
    object_affordance(kitchen:fridge, Affordance), short(Affordance, Name).
test(the_cartons_stand_side_by_side, [nondet]) :- near(kitchen:milk_carton_1, kitchen:milk_carton_2).

test(milk_belongs_into_the_fridge, all(Name == [fridge])) :- place_for(knowrob:'CowsMilk', Place), short(Place, Name).
test(since_it_spoils, all(Name == ['Perishable'])) :-
    storagePlaceForBecause(kitchen:fridge, kitchen:milk_carton_1, Because), short(Because, Name).

test(milk_is_in_the_fridge) :- once(in_ContGeneric(kitchen:milk_carton_1, kitchen:fridge)).
test(milk_is_above_the_floor) :- once(on_Physical(kitchen:milk_carton_1, kitchen:floor)).
test(above_and_below) :-
    once(comp_above_of(kitchen:milk_carton_1, kitchen:floor)), once(comp_below_of(kitchen:floor, kitchen:milk_carton_1)).
test(left_and_right_are_opposite) :-
    once(comp_toTheLeftOf(A, B)), once(comp_toTheRightOf(B, A)), once(comp_toTheSideOf(A, B)).
test(before_and_behind) :-
    current_object_pose(kitchen:hob, [_, _, [X, _, _], _]), current_object_pose(kitchen:fridge, [_, _, [Y, _, _], _]),
    (   X > Y -> once(comp_inFrontOf(kitchen:hob, kitchen:fridge)) ; once(comp_inFrontOf(kitchen:fridge, kitchen:hob)) ), !.
test(the_yogurt_is_in_the_middle_of_the_fridge, all(Name == [yogurt_cup_1])) :-
    comp_inCenterOf(kitchen:fridge, Thing), short(Thing, Name).
test(relations_are_properties, true(Number == 12)) :-
    aggregate_all(count, rdf_has(_, knowrob:'in-ContGeneric', kitchen:fridge), Number).

test(a_relation_holds) :- once(holds(in_ContGeneric(kitchen:milk_carton_1, kitchen:fridge))).
test(it_holds_now) :- get_timepoint(Now), once(holds(in_ContGeneric(kitchen:milk_carton_1, kitchen:fridge), Now)).
test(it_holds_as_a_triple) :- once(holds(kitchen:milk_carton_1, knowrob:'in-ContGeneric', kitchen:fridge)).
test(it_holds_as_a_triple_now) :-
    get_timepoint(Now), once(holds(kitchen:milk_carton_1, knowrob:'in-ContGeneric', kitchen:fridge, Now)).

:- end_tests(kitchen).
