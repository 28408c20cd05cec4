% The names of B. Veit's thesis, in its order of arguments. docs/how-to/prolog.md describes them.

:- module(mindstage_thesis,
          [ map_instance/1, map_root_object/2, get_subclass_in_map/3,
            likely_storage_place/2, likely_storage_place_in_environment/3, owl_class_properties/3,
            analyse_semantic_map/6, identical_maps/2, identical_maps/3,
            highlight/1, highlight/2, unhighlight/0,
            highlight_everything_that_is/2, highlight_likely_storage_place/2,
            highlight_handle_of/2, highlight_device_for_action/3,
            spawn_semantic_map/1, spawn_models/2, spawn_constraints/2, spawn_relations/3,
            attach_model/2, debug_failed_items/0, failed_item/3, owl_parse/1 ]).
:- use_module(asking).
:- use_module(names).
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
    question(analyse, [Map, Classes, Individuals, Objects, Constraints, Relations]).
% As in the thesis: poses, masses and limits. The question itself (identical, differences) compares all that maps say.
identical_maps(One, Other) :- identical_maps(One, Other, 0.0).
identical_maps(One, Other, Tolerance) :- question(identical_maps, [One, Other, Tolerance, _, true, _]).

% The value is a class, a literal, or union_of([...]), intersection_of([...]), restriction(Property, Kind, Value).
owl_class_properties(Class, Property, Value) :- answers(owl_class_properties(Class, Property), [Class, Property, Value]).

% -- the running world -------------------------------------------------------------------------------------------------

spawn_semantic_map(Map) :-
    map_instance(Map),
    request(spawn(Map), Done),
    complete(Done).

% What is left open becomes all that the map has.
spawn_models(Map, Models) :-
    contents(Map, contents(All, _, _, _)),
    all_or_some(All, Models),
    request(spawn_models(Map, Models), Done),
    complete(Done).

spawn_constraints(Map, Constraints) :-
    contents(Map, contents(_, All, _, _)),
    all_or_some(All, Constraints),
    request(spawn_constraints(Map, Constraints), Done),
    complete(Done).

spawn_relations(Map, Parents, Children) :-
    contents(Map, contents(_, _, AllParents, AllChildren)),
    (   var(Parents), var(Children)
    ->  Parents = AllParents, Children = AllChildren
    ;   must_be(list, Parents), must_be(list, Children)
    ),
    request(spawn_relations(Map, Parents, Children), Done),
    complete(Done).

contents(Map, Contents) :-
    map_instance(Map),
    request(contents(Map), Contents).

all_or_some(All, Some) :- var(Some), !, Some = All.
all_or_some(_, Some) :- must_be(list, Some).

complete(true).
complete(false) :-
    aggregate_all(count, failed_item(_, _, _), Number),
    print_message(warning, mindstage_failed(Number)),
    fail.

failed_item(Kind, Id, Reason) :- request(failed_items, Items), member(failed(Kind, Id, Reason), Items).

debug_failed_items :- forall(failed_item(Kind, Id, Reason), format("~w ~w: ~w~n", [Kind, Id, Reason])).

attach_model(Parent, Child) :- request(attach(Parent, Child), _).

owl_parse(Source) :-
    request(owl_parse(Source), _),
    request(prefixes, Pairs),
    keep_prefixes(Pairs).

% -- lights ------------------------------------------------------------------------------------------------------------

highlight(Individuals) :- highlight(Individuals, green).

% highlight(+Individuals, +Colour): one or a list; a name, '#rrggbb', rgb(R, G, B) from 0 to 1, or none.
highlight(Individuals, Colour) :- light(Individuals, Colour, '').

unhighlight :- request(unhighlight, _).

highlight_everything_that_is(Map, Class) :-
    lit(Individual, get_subclass_in_map(Map, Class, Individual), _).
highlight_likely_storage_place(Map, ItemClass) :-
    lit(Individual, likely_storage_place_in_environment(Map, ItemClass, Individual), _).
highlight_handle_of(Map, Individual) :-
    lit(Handle, handle_of(Map, Individual, Handle), _).
highlight_device_for_action(Map, ActionClass, Device) :-
    lit(Device, device_for_action_in_environment(Map, ActionClass, Device), Devices),
    member(Device, Devices).

% lit(?Answer, :Question, -Answers): lights all of them at once; false, and nothing changes, where there is none.
lit(Answer, Question, Answers) :-
    reason(Question, Reason),
    findall(Answer, mindstage:Question, Found),
    list_to_set(Found, Answers),
    Answers \== [],
    light(Answers, green, Reason).

% What is open in a question is shown as "_".
reason(Question, Reason) :-
    copy_term(Question, Shown),
    term_variables(Shown, Open),
    maplist(=('$VAR'('_')), Open),
    format(atom(Reason), "~p", [Shown]).

% Some of them may have no body, which is told; an error is that none of them has one.
light(Individuals, Colour, Reason) :-
    (   is_list(Individuals) -> All = Individuals ; All = [Individuals] ),
    must_be(list(nonvar), All),
    request(highlight(All, Colour, Reason), shown(Lit, Dark)),
    (   Lit =:= 0, Dark = [dark(Name, Why)|_]
    ->  format(string(Sentence), "~w stays dark: ~w", [Name, Why]),
        throw(mindstage_error(body_unknown, Sentence))
    ;   forall(member(dark(Name, Why), Dark), print_message(warning, mindstage_dark(Name, Why)))
    ).
