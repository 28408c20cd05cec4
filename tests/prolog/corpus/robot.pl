% A robot in front of a cupboard with a mug: what it is able to do, and a plan that is tried before it is done.

:- module(serve_mug, [able/1, safe/1]).

short(Iri, Name) :- rdf_split_url(_, Name, Iri).
able(Action) :- action_feasible_on_robot(Action, mobile_manipulator).
safe(Plan) :- evaluate_plan(Plan, verdict(succeeded, _, _, _)).

:- begin_tests(robot).

test(it_is_added, all(Robot == [mobile_manipulator])) :- add_robot(mobile_manipulator, at(-0.5, 0.5), _), robot(Robot).
test(it_picks_things_up, [nondet]) :- able(knowrob:'PickingUpAnObject').
test(nothing_is_missing_for_that) :-
    \+ missing_cap_for_action(knowrob:'PickingUpAnObject', mobile_manipulator, _),
    \+ missing_comp_for_action(knowrob:'PickingUpAnObject', mobile_manipulator, _),
    \+ missing_for_action(mobile_manipulator, knowrob:'PickingUpAnObject', _, _).
test(waiting_is_safe) :- safe([wait(0.1)]).
test(a_mug_that_is_pushed_over_the_edge, true(Outcome == failed)) :-
    Mug = 'Mug',
    evaluate_plan([move(Mug, by(-1.0, 0.0, 0.0)), wait(1)], verdict(Outcome, _, Samples, _),
                      [samples(2), seed(1), check(where_is(thing='Mug', other='Cupboard'))]),
    Samples >= 1.
test(it_parks, true(Outcome == succeeded)) :- perform(park, result(Outcome, _, _)).
test(it_parks_by_name, true(Outcome == succeeded)) :- perform(park, result(Outcome, _, _), [robot(mobile_manipulator), deadline(60)]).
test(a_second_one_finds_a_free_place, true(Number == 2)) :-
    add_robot(mobile_manipulator, _), aggregate_all(count, robot(_), Number).

:- end_tests(robot).
