% Plans that are tried in copies of the running world.

:- module(mindstage_plans, [evaluate_plan/2, evaluate_plan/3]).
:- use_module(questions).
:- use_module(library(error)).
:- use_module(library(lists)).

%!  evaluate_plan(+Plan, -Verdict) is semidet.
%!  evaluate_plan(+Plan, -Verdict, +Options) is semidet.
%
%   Tries a plan in copies of the world, which itself stays as it is. Plan is a list of steps, such as
%   [place(milk_1, on(table_1)), wait(2)], or a text with JSON or YAML. Verdict is unified with
%   verdict(Outcome, Probability, Samples, Why); Outcome is succeeded, failed or unknown. Options are samples(N), seed(N),
%   budget(Seconds), threshold(P), workers(N), check(Question) and uncertainty(Thing, [position_m(0.01), mass(0.1)]).
evaluate_plan(Plan, Verdict) :- evaluate_plan(Plan, Verdict, []).
evaluate_plan(Plan, Verdict, Options) :-
    must_be(ground, Plan),
    must_be(list, Options),
    must_be(ground, Options),
    request(evaluate_plan(Plan, Options), Verdict).
