% Robots of the running world: skills, designated actions, and what they are able to do.

:- module(mindstage_robots, [add_robot/2, add_robot/3, robot/1, perform/2, perform/3,
                             action_feasible_on_robot/2, missing_for_action/4,
                             missing_cap_for_action/3, missing_comp_for_action/3]).
:- use_module(questions).
:- use_module(library(error)).
:- use_module(library(lists)).

%!  add_robot(+Model, -Name) is det.
%!  add_robot(+Model, +At, -Name) is det.
%
%   Adds a robot to the world: at a free place of the floor, or at at(X, Y) or at(X, Y, Yaw) [m, rad].
add_robot(Model, Name) :-
    must_be(ground, Model),
    request(add_robot(Model, free), Name).
add_robot(Model, At, Name) :-
    must_be(ground, Model-At),
    request(add_robot(Model, At), Name).

%!  robot(?Name) is nondet.
%
%   The robots of the world.
robot(Name) :-
    request(robots, Names),
    member(Name, Names).

%!  perform(+Action, -Result) is det.
%!  perform(+Action, -Result, +Options) is det.
%
%   Lets a robot do something in the running world. Action is a skill with its arguments in their order or as Name=Value,
%   such as put_away(milk_1) or go_to(x=1.0, y=0.5); a designator, such as [an, action, [type, fetching], [object, [an,
%   object, [type, 'Milk']]]], or an atom or string with one as JSON; or a list of skills. Result is unified with
%   result(Outcome, Why, Seconds); Outcome is succeeded, failed, unknown, or not_done if a trial was not probable enough.
%   Options are robot(Name), deadline(Seconds) and try_first(P) with those of evaluate_plan.
perform(Action, Result) :- perform(Action, Result, []).
perform(Action, Result, Options) :-
    must_be(ground, Action),
    must_be(list, Options),
    must_be(ground, Options),
    request(perform(Action, Options), Result).

% -- SRDL --------------------------------------------------------------------------------------------------------------

%!  action_feasible_on_robot(?Action, ?Robot) is nondet.
%!  missing_for_action(?Action, ?Robot, -MissingCapability, -MissingComponent) is nondet.
%!  missing_cap_for_action(?Action, ?Robot, ?Capability) is nondet.
%!  missing_comp_for_action(?Action, ?Robot, ?Component) is nondet.
%
%   As in KnowRob's srdl2, by the questions can and missing_for_action. Capabilities that depend on nothing are missing
%   unless they are stated.
action_feasible_on_robot(Action, Robot) :-
    question(can, [Robot, Action, _, _, _]).

missing_for_action(Action, Robot, Capability, _) :- missing_cap_for_action(Action, Robot, Capability).
missing_for_action(Action, Robot, _, Component) :- missing_comp_for_action(Action, Robot, Component).

missing_cap_for_action(Action, Robot, Capability) :-
    question(missing_for_action, [Robot, Action, Capability, capability, _, _]).

missing_comp_for_action(Action, Robot, Component) :-
    question(missing_for_action, [Robot, Action, Component, component, _, _]).
