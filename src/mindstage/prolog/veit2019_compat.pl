% Compatibility with the predicates of B. Veit's thesis (2019): the same names and order of arguments, see
% docs/how-to/prolog.md.

:- module(mindstage_veit2019_compat,
          [ map_instance/1, map_root_object/2, get_subclass_in_map/3,
            likely_storage_place/2, likely_storage_place_in_environment/3, owl_class_properties/3,
            analyse_semantic_map/6, identical_maps/2, identical_maps/3,
            highlight/1, highlight/2, highlight_models/1, unhighlight/0,
            highlight_everything_that_is/2, highlight_likely_storage_place/2,
            highlight_handle_of/2, highlight_handle_of/3,
            highlight_device_for_action/2, highlight_device_for_action/3,
            spawn_semantic_map/1, spawn_models/2, spawn_constraints/2, spawn_relations/3,
            spawn_model/9, spawn_constraint/1, attach_model_to_parent/2,
            attach_model/2, debug_failed_items/0, failed_item/3 ]).
:- use_module(questions).
:- use_module(prefixes).
:- use_module(library(aggregate)).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).

% -- questions under other names ---------------------------------------------------------------------------------------

map_instance(Map) :- question(maps, [Map]).
map_root_object(Map, Individual) :- question(everything_in_map, [Map, Individual]).
get_subclass_in_map(Map, Class, Individual) :- question(individual_of_class, [Map, Class, Individual]).
likely_storage_place(ItemClass, StorageClass) :- question(storage_place, [ItemClass, StorageClass]).
likely_storage_place_in_environment(Map, ItemClass, Individual) :-
    question(storage_place_in_environment, [Map, ItemClass, Individual]).
analyse_semantic_map(Map, Classes, Individuals, Objects, Constraints, Relations) :-
    question(analyze, [Map, Classes, Individuals, Objects, Constraints, Relations]).
% Compares poses, masses and joint limits, as in the thesis. The questions `identical` and `differences` compare everything.
identical_maps(One, Other) :- identical_maps(One, Other, 0.0).
identical_maps(One, Other, Tolerance) :- question(identical_maps, [One, Other, Tolerance, _, true, _]).

% Value is a class, a literal, union_of([...]), intersection_of([...]) or restriction(Property, Kind, Value).
owl_class_properties(Class, Property, Value) :- answers(owl_class_properties(Class, Property), [Class, Property, Value]).

% -- the running world -------------------------------------------------------------------------------------------------

spawn_semantic_map(Map) :-
    map_instance(Map),
    request(spawn(Map), Done),
    check_complete(Done).

% Unbound arguments are bound to all models, constraints or relations of the map.
spawn_models(Map, Models) :-
    contents(Map, contents(All, _, _, _)),
    all_if_unbound(All, Models),
    request(spawn_models(Map, Models), Done),
    check_complete(Done).

spawn_constraints(Map, Constraints) :-
    contents(Map, contents(_, All, _, _)),
    all_if_unbound(All, Constraints),
    request(spawn_constraints(Map, Constraints), Done),
    check_complete(Done).

spawn_relations(Map, Parents, Children) :-
    contents(Map, contents(_, _, AllParents, AllChildren)),
    (   var(Parents), var(Children)
    ->  Parents = AllParents, Children = AllChildren
    ;   must_be(list, Parents), must_be(list, Children)
    ),
    request(spawn_relations(Map, Parents, Children), Done),
    check_complete(Done).

contents(Map, Contents) :-
    map_instance(Map),
    request(contents(Map), Contents).

all_if_unbound(All, Some) :- var(Some), !, Some = All.
all_if_unbound(_, Some) :- must_be(list, Some).

check_complete(true).
check_complete(false) :-
    aggregate_all(count, failed_item(_, _, _), Number),
    print_message(warning, mindstage_failed(Number)),
    fail.

failed_item(Kind, Id, Reason) :- request(failed_items, Items), member(failed(Kind, Id, Reason), Items).

debug_failed_items :- forall(failed_item(Kind, Id, Reason), format("~w ~w: ~w~n", [Kind, Id, Reason])).

% The foreign predicates that the thesis's spawn_semantic_map.pl calls. They fail, with a warning that has the reason, if
% nothing was spawned.
% spawn_model(+Id, +Class, +X, +Y, +Z, +QX, +QY, +QZ, +QW): a body of a loaded map, or a new one of the class.
spawn_model(Id, Class, X, Y, Z, Qx, Qy, Qz, Qw) :-
    request(spawn_model(Id, Class, [X, Y, Z, Qx, Qy, Qz, Qw]), Done),
    check_done(Id, Done).

% spawn_constraint(+Parts): parent, child, position, quaternion, three linear motions, limit, soft, stiffness, damping, three
% angular motions and limits, and soft, stiffness and damping of swing and of twist.
spawn_constraint(Parts) :-
    request(spawn_constraint(Parts), Done),
    check_done(constraint, Done).

attach_model_to_parent(Parent, Child) :-
    request(attach_models(Parent, Child), Done),
    check_done(Child, Done).

check_done(_, true) :- !.
check_done(Id, Reason) :- print_message(warning, mindstage_not_spawned(Id, Reason)), fail.

:- multifile prolog:message//1.
prolog:message(mindstage_not_spawned(Id, Reason)) --> [ '~w was not spawned: ~w'-[Id, Reason] ].

attach_model(Parent, Child) :- request(attach(Parent, Child), _).

% -- highlights ------------------------------------------------------------------------------------------------------------

highlight(Individuals) :- highlight(Individuals, green).

% highlight(+Individuals, +Color): an individual or a list; a color name, '#rrggbb', rgb(R, G, B) from 0 to 1, or none.
highlight(Individuals, Color) :- highlight_bodies(Individuals, Color, '').

% highlight_models(+Ids): ids of bodies or names of individuals, as texts.
highlight_models(Ids) :-
    must_be(list, Ids),
    highlight_bodies(Ids, green, '').

unhighlight :- request(unhighlight, _).

highlight_everything_that_is(Map, Class) :-
    highlight_answers(Individual, get_subclass_in_map(Map, Class, Individual), _).
highlight_likely_storage_place(Map, ItemClass) :-
    highlight_answers(Individual, likely_storage_place_in_environment(Map, ItemClass, Individual), _).
highlight_handle_of(Map, Individual) :-
    highlight_answers(Handle, handle_of(Map, Individual, Handle), _).
highlight_handle_of(Map, Individual, Handle) :-
    highlight_answers(Handle, handle_of(Map, Individual, Handle), Handles),
    member(Handle, Handles).

highlight_device_for_action(Map, ActionClass) :-
    highlight_answers(Device, device_for_action_in_environment(Map, ActionClass, Device), _).

% highlight_device_for_action(?Map, ?ActionClass, ?DeviceClass): the individuals of each class of devices in turn.
highlight_device_for_action(Map, ActionClass, DeviceClass) :-
    question(device_for_action, [ActionClass, DeviceClass]),
    highlight_everything_that_is(Map, DeviceClass).

% highlight_answers(?Answer, :Question, -Answers): highlights all answers at once; fails without changes if there is none.
highlight_answers(Answer, Question, Answers) :-
    highlight_label(Question, Reason),
    findall(Answer, mindstage:Question, Found),
    list_to_set(Found, Answers),
    Answers \== [],
    highlight_bodies(Answers, green, Reason).

% The label of highlighted answers: the question, with unbound variables shown as "_".
highlight_label(Question, Reason) :-
    copy_term(Question, Shown),
    term_variables(Shown, Open),
    maplist(=('$VAR'('_')), Open),
    format(atom(Reason), "~p", [Shown]).

% Prints a warning for individuals without a body; throws an error if none of them has one.
highlight_bodies(Individuals, Color, Reason) :-
    (   is_list(Individuals) -> All = Individuals ; All = [Individuals] ),
    must_be(list(nonvar), All),
    request(highlight(All, Color, Reason), highlighted(Count, NotHighlighted)),
    (   Count =:= 0, NotHighlighted = [not_highlighted(Name, Why)|_]
    ->  format(string(Sentence), "~w cannot be highlighted: ~w", [Name, Why]),
        throw(mindstage_error('BodyNotFoundError', Sentence))
    ;   forall(member(not_highlighted(Name, Why), NotHighlighted), print_message(warning, mindstage_not_highlighted(Name, Why)))
    ).
