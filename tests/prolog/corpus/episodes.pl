% What happened in a recorded episode: 0 to 3 s; a drawer was opened, a mug was picked up and is on the fridge from 2 s on.

:- module(breakfast, [picked/2]).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).
picked(Thing, Begin) :- occurs(Event, [Begin, _], ms:'PickingUp'), has_participant(Event, Thing, knowrob:'Cup').

:- begin_tests(episodes).

test(one_episode, all(Name == [run])) :- episode(Name).
test(its_interval, [nondet, true(Times == [0.0, 3.0])]) :- episode(run, Times).
test(the_mug_was_picked_up_after_a_second, [nondet, true(Name-Begin == 'Mug'-1.0)]) :- picked(Thing, Begin), short(Thing, Name).
test(three_events, true(Number == 3)) :- aggregate_all(count, occurs(_), Number).
test(at_one_moment, all(Name == ['PickingUp_1'])) :- occurs(Event, 1.4), short(Event, Name).
test(all_are_of_one_episode, true(Names == [run])) :- findall(E, event_episode(_, E), Es), sort(Es, Names).
test(two_actions, true(Names == ['Opening_1', 'PickingUp_1'])) :-
    findall(Name, ( event_type(Event, knowrob:'Action'), short(Event, Name) ), Found), sort(Found, Names).
test(who_did_it, all(Agent == [viewer])) :- event_agent('PickingUp_1', Agent).
test(with_what, all(Name == ['PickingUp_1'])) :- has_participant(Event, 'Cupboard'), short(Event, Name).
test(roles, true(Names == ['Patient', 'Supporter'])) :-
    findall(Name, ( executes_task('PickingUp_1', Task), task_role(Task, _, Class), short(Class, Name) ), Found), sort(Found, Names).
test(relation_of_events, all(Relation == [overlaps])) :- temporal_relation('Opening_1', 'PickingUp_1', Relation).
test(the_opening_comes_before_the_fridge) :- once(before('Opening_1', 'SupportedBy_1')), once(after('SupportedBy_1', 'Opening_1')).
test(they_overlap) :- once(overlaps('Opening_1', 'PickingUp_1')), once(overlapped_by('PickingUp_1', 'Opening_1')).
test(intervals_meet) :- meets([0, 1], [1, 2]), met_by([1, 2], [0, 1]).
test(intervals_start) :- starts([0, 1], [0, 2]), started_by([0, 2], [0, 1]).
test(intervals_finish) :- finishes([1, 2], [0, 2]), finished_by([0, 2], [1, 2]).
test(intervals_contain) :- contains([0, 3], [1, 2]), during([1, 2], [0, 3]).
test(intervals_are_equal) :- equals([0, 3], [0, 3]), \+ equals([0, 3], [0, 2]).
test(height_before_and_after, [nondet, true(Low-High == 0.85-1.85)]) :-
    object_pose_at_time('Mug', 1.0, [_, _, Low], _), object_pose_at_time('Mug', 2.5, [_, _, High], _).
test(on_the_fridge, [nondet, true(T == 2.0)]) :- is_supported_by('Mug', 'Fridge') since T.

:- end_tests(episodes).
