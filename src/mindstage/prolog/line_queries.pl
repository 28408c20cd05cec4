% Queries from untrusted clients, such as the viewer: conjunctions and other combinations of questions.
%
% A query is parsed to a term, and each goal in it is checked against an allowlist before anything runs. A goal that is not
% listed is an error: a query cannot call, change, read or write anything else, whatever its variables are bound to.
%
% Prolog shares equal subterms, so that X = f(Y, Y), Y = f(Z, Z) … makes a small term that becomes exponentially large where
% it is copied or printed. The terms of all variables are therefore limited in size after each goal that may bind them,
% counted as a copy has it.

:- module(mindstage_line_queries, [query_goal/3, call_bounded/1]).
:- use_module(library(aggregate)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(occurs)).

max_characters(4000).
max_inferences(5000000).
max_parts(50000).
max_arity(16).

% query_goal(+Text, -Variables, -Goal): the checked goal; throws a syntax error or mindstage_error('PrologGoalError', Sentence).
query_goal(Text, Variables, Goal) :-
    string_length(Text, Length),
    max_characters(Most),
    (   Length > Most -> throw_goal_refused("a query has at most ~w characters, not ~w", [Most, Length]) ; true ),
    % Quasi quotations, {| |}, call a parser while the text is read.
    (   sub_string(Text, _, _, _, "{|") -> throw_goal_refused("{| |} cannot be asked here", []) ; true ),
    term_string(Term, Text, [variable_names(Variables), module(mindstage_line_queries)]),
    (   Term == end_of_file -> syntax_error(end_of_file) ; true ),
    require_small_arity(Term),
    checked_goal(Term, Variables, Goal).

% The number of arguments would be a further factor of the size of a copy.
require_small_arity(Term) :-
    max_arity(Most),
    forall(( sub_term(Part, Term), compound(Part), functor(Part, Name, Arity), Arity > Most ),
           throw_goal_refused("~q has ~D arguments, and a term of a query has at most ~D", [Name, Arity, Most])).

% call_bounded(:Goal): calls a goal with a limit of inferences.
call_bounded(Goal) :-
    max_inferences(Most),
    call_with_inference_limit(mindstage_line_queries:Goal, Most, Result),
    (   Result == inference_limit_exceeded -> throw_goal_refused("the query takes more than ~D inferences; narrow it", [Most]) ; true ).

% bounded(+Term): fails if a term is cyclic, throws if it is too large.
bounded(Term) :-
    acyclic_term(Term),
    max_parts(Most),
    (   size_abstract_term(Most, t(Term), Part), Part == t(Term) -> true  % t/1, since a variable would be renamed
    ;   throw_goal_refused("the memory limit was exceeded (a term has more than ~D parts)", [Most])
    ).

% checked_goal(?Term, +Variables, -Goal): the goal to run for a term of the query, which has these variables.
checked_goal(Term, _, _) :- var(Term), !, throw_goal_refused("a goal must not be a variable", []).
checked_goal((A, B), All, (X, Y)) :- !, checked_goal(A, All, X), checked_goal(B, All, Y).
checked_goal((A ; B), All, (X ; Y)) :- !, checked_goal(A, All, X), checked_goal(B, All, Y).
checked_goal((A -> B), All, (X -> Y)) :- !, checked_goal(A, All, X), checked_goal(B, All, Y).
checked_goal(\+ A, All, \+ X) :- !, checked_goal(A, All, X).
checked_goal(forall(A, B), All, forall(X, Y)) :- !, checked_goal(A, All, X), checked_goal(B, All, Y).
checked_goal(findall(Template, A, List), All, (findall(Template, (X, bounded(Template)), List), bounded(All))) :- !,
    checked_goal(A, All, X).
checked_goal(aggregate_all(count, A, Count), All, (aggregate_all(count, X, Count), bounded(All))) :- !,
    checked_goal(A, All, X).
checked_goal(length(List, Length), _, (is_list(List), length(List, Length))) :- !.
checked_goal(Term, _, (number(A), number(B), Term)) :- comparison(Term, A, B), !.
checked_goal(member(Element, List), All, Goal) :- !,
    (   var(Element), is_anonymous(Element, All) -> Goal = member(Element, List)  % binds no other term
    ;   Goal = (bounded(List), member(Element, List), bounded(All))
    ).
checked_goal(Term, All, (bounded(Term), Term, bounded(All))) :- allowed_builtin(Term), !.
checked_goal(Term, All, (bounded(Term), mindstage:Term, bounded(All))) :- callable(Term), allowed_question(Term), !.
checked_goal(Term, _, _) :-
    (   callable(Term) -> functor(Term, Name, Arity), What = Name/Arity ; What = Term ),
    throw_goal_refused("~q cannot be asked here, only questions combined with , ; -> \\+ = \\= == < > member length findall forall", [What]).

is_anonymous(Variable, All) :- \+ ( member(_=Other, All), Other == Variable ).

% Comparisons are limited to numbers, since they evaluate arithmetic expressions.
comparison(A < B, A, B).
comparison(A > B, A, B).
comparison(A =< B, A, B).
comparison(A >= B, A, B).
comparison(A =:= B, A, B).
comparison(A =\= B, A, B).

allowed_builtin(true).
allowed_builtin(fail).
allowed_builtin(false).
allowed_builtin(_ = _).
allowed_builtin(_ \= _).
allowed_builtin(_ == _).
allowed_builtin(_ \== _).
allowed_builtin(_ @< _).
allowed_builtin(_ @> _).
allowed_builtin(_ @=< _).
allowed_builtin(_ @>= _).
allowed_builtin(memberchk(_, _)).
allowed_builtin(msort(_, _)).
allowed_builtin(sort(_, _)).
allowed_builtin(nonvar(_)).
allowed_builtin(var(_)).

% allowed_question(+Head): a declared question, or a question under its name in the thesis.
allowed_question(map_instance(_)).
allowed_question(map_root_object(_, _)).
allowed_question(get_subclass_in_map(_, _, _)).
allowed_question(likely_storage_place(_, _)).
allowed_question(likely_storage_place_in_environment(_, _, _)).
allowed_question(owl_class_properties(_, _, _)).
allowed_question(analyse_semantic_map(_, _, _, _, _, _)).
allowed_question(identical_maps(_, _)).
allowed_question(identical_maps(_, _, _)).
allowed_question(Head) :-
    functor(Head, Name, Arity),
    memberchk(Name/Arity,
              [ get_timepoint/1, get_timepoint/2, current_object_pose/2, object_pose_at_time/3, object_pose_at_time/4,
                object_detection/3, object_distance/3, object_dimensions/4, object_color/2, object_mesh_path/2,
                object_affordance/2, object_frame_name/2, storagePlaceFor/2, storagePlaceForBecause/3,
                map_root_objects/2, map_child_object/2, map_child_objects/2, map_object_info/1, map_object_type/2,
                map_object_label/2, map_object_dimensions/4, map_connection_type/3, map_joint_name/3,
                on_Physical/2, in_ContGeneric/2, comp_toTheLeftOf/2, comp_toTheRightOf/2, comp_toTheSideOf/2,
                comp_inFrontOf/2, comp_inCenterOf/2, comp_above_of/2, comp_below_of/2,
                holds/1, holds/2, holds/3, holds/4, occurs/1, occurs/2, occurs/3,
                triple/3, has_type/2, instance_of/2, subclass_of/2, is_a/2, is_individual/1, is_class/1,
                is_at/2, has_part/2, is_inside_of/2, is_supported_by/2, entity/2, kb_triple/3, kb_type_of/2,
                episode/1, episode/2, event_episode/2, event_type/2, event_agent/2, has_participant/2, has_participant/3,
                executes_task/2, task_role/3, temporal_relation/3, before/2, after/2, meets/2, met_by/2, overlaps/2,
                overlapped_by/2, starts/2, started_by/2, during/2, contains/2, finishes/2, finished_by/2, equals/2 ]).
allowed_question(Head) :-
    functor(Head, Name, Arity),
    functor(General, Name, Arity),
    predicate_property(mindstage:General, defined),
    \+ predicate_property(mindstage:General, imported_from(_)),
    catch(clause(mindstage:General, mindstage_questions:question(Name, _)), _, fail).

throw_goal_refused(Format, Arguments) :-
    format(string(Sentence), Format, Arguments),
    throw(mindstage_error('PrologGoalError', Sentence)).
